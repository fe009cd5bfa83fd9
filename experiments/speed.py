"""Speed beside other libraries in the same run."""

from adhesion_jax.command_line.command import run
from adhesion_jax.command_line.speed import main

if __name__ == "__main__":
    run(main)
