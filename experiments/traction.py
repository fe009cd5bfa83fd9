"""Run a published traction control system on its plant and judge it."""

from adhesion_jax.command_line.command import run
from adhesion_jax.command_line.traction import main

if __name__ == "__main__":
    run(main)
