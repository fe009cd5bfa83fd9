"""`python -m experiments.identify`: which adhesion curve measured points follow."""

from adhesion_jax.commands.command import run
from adhesion_jax.commands.identify import main

if __name__ == "__main__":
    run(main)
