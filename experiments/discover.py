"""`python -m experiments.discover`: which physical effect a law lacks in measured data."""

from adhesion_jax.commands.command import run
from adhesion_jax.commands.discover import main

if __name__ == "__main__":
    run(main)
