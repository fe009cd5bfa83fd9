"""Run a published traction control system on its plant and judge it."""

from adhesion_jax.commands.command import run
from adhesion_jax.commands.traction import main

if __name__ == "__main__":
    run(main)
