"""Hold the discovery against what a user would try instead on the residual of a base curve."""

from adhesion_jax.command_line.command import run
from adhesion_jax.command_line.peers import main

if __name__ == "__main__":
    run(main)
