"""While tested, the package is checked against the shapes and types it declares."""

from hypothesis import settings
from jaxtyping import install_import_hook

# Here, before any test module imports the package: the hook works on what is imported after it.
install_import_hook("adhesion_jax", "beartype.beartype")

# The same examples on every machine, and no deadline: the first example compiles.
settings.register_profile("repeatable", derandomize=True, deadline=None, max_examples=40)
settings.load_profile("repeatable")
