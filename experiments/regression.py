"""Hold the accuracy and the speed of every identifier against a baseline and say what moved."""

from adhesion_jax.command_line.command import run
from adhesion_jax.command_line.regression import main

if __name__ == "__main__":
    run(main)
