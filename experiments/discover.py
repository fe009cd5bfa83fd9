"""`python -m experiments.discover`: which physical effect a law lacks in measured data."""

from adhesion_jax.command_line.command import run
from adhesion_jax.command_line.discover import main

if __name__ == "__main__":
    run(main)
