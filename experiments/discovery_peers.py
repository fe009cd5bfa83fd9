"""Hold the discovery against what a user would try instead on the residual of a base curve."""

from adhesion_jax.commands.command import run
from adhesion_jax.commands.discovery_peers import main

if __name__ == "__main__":
    run(main)
