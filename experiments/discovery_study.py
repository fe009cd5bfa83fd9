"""Measure how often the discovery is right: false claims, detection, confusions, random effects."""

from adhesion_jax.command_line.command import run
from adhesion_jax.command_line.study import main

if __name__ == "__main__":
    run(main)
