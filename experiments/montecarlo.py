"""Identify thousands of noisy adhesion curves and say how well each method knows them."""

from adhesion_jax.command_line.command import run
from adhesion_jax.command_line.montecarlo import main

if __name__ == "__main__":
    run(main)
