"""What all tests share: their repeatable examples, quick programs and checked shapes."""

import ctypes
import gc
import os
import resource
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
import shapes
from hypothesis import settings
from threadpoolctl import threadpool_limits

# The same examples on every machine, and no deadline: the first example compiles.
settings.register_profile("repeatable", derandomize=True, deadline=None, max_examples=40)
settings.load_profile("repeatable")

# Most tests run once what they compile; programs that name a level of their own keep it. Without
# the fusion emitters loops take half as long again to run, and half as long to compile. And a
# program is not parted for several threads to compile: that takes a tenth longer in all.
_QUICK = (
    "--xla_backend_optimization_level=0 --xla_cpu_use_fusion_emitters=false"
    " --xla_cpu_parallel_codegen_split_count=1"
)
os.environ["XLA_FLAGS"] = f"{os.environ.get('XLA_FLAGS', '')} {_QUICK}".strip()

# There are as many workers as cores: more threads than that wait for each other by turning. numpy
# takes the number of the moment when it is loaded, and a plugin may have loaded it before.
for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(_name, "1")
threadpool_limits(1)

# Garbage is looked for seldom: a fortieth of the time.
gc.set_threshold(20_000, 20, 20)

#: From so many bytes on a worker lets go of what it has compiled: two have to do with 4 GB, with
#: what the largest module adds to this and the processes that tests start.
_MUCH = 800e6


@pytest.fixture(scope="module", autouse=True)
def room_for_programs():
    """Let go of what earlier modules compiled, once that is much."""
    own = Path("/proc/self/statm")
    if own.exists() and int(own.read_text().split()[1]) * resource.getpagesize() > _MUCH:
        import jax  # which reads the environment that is set here

        jax.clear_caches()
        ctypes.CDLL(None).malloc_trim(0)  # without it the system gets nothing back


def pytest_collection_finish():
    """Do not look for garbage in all that was loaded so far: that takes a twentieth of the time."""
    gc.freeze()


def pytest_configure(config):
    """Check shapes; and all processes of a session keep and share what they compile."""
    # Tests of these lanes repeat with more cases and draws what the others check.
    if config.getoption("markexpr") not in ("thorough", "slow", "clock"):
        shapes.install()  # before any test module imports the package

    # After the flags above and the finder of checked modules.
    import jax

    from adhesion_jax import runtime

    runtime.start()
    if jax.config.values["jax_compilation_cache_dir"] is None:
        # The many small programs of tests pass with the session: a bounded folder is looked
        # through whenever something is added to it.
        passing = TemporaryDirectory()
        config.add_cleanup(passing.cleanup)
        os.environ["JAX_COMPILATION_CACHE_DIR"] = passing.name  # which workers inherit
        jax.config.update("jax_compilation_cache_dir", passing.name)
    jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
