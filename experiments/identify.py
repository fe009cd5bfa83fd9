"""`python -m experiments.identify`: which adhesion curve measured points follow."""

from adhesion_jax.command_line.command import run
from adhesion_jax.command_line.identify import main

if __name__ == "__main__":
    run(main)
