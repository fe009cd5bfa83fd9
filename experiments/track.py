"""`python -m experiments.track`: a log followed by online methods, sample by sample."""

from adhesion_jax.command_line.command import run
from adhesion_jax.command_line.track import main

if __name__ == "__main__":
    run(main)
