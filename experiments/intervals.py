"""`python -m experiments.intervals`: how often the intervals of identify hold the truth."""

from adhesion_jax.command_line.command import run
from adhesion_jax.command_line.intervals import main

if __name__ == "__main__":
    run(main)
