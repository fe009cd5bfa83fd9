"""`python -m experiments.plan`: how many samples, and up to which slip, to know the peak."""

from adhesion_jax.command_line.command import run
from adhesion_jax.command_line.plan import main

if __name__ == "__main__":
    run(main)
