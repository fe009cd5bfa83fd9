"""Speed on one core beside a peer in the same run: blocks beside scipy, recursions beside NumPy."""

from adhesion_jax.command_line.command import run
from adhesion_jax.command_line.speed import main

if __name__ == "__main__":
    run(main)
