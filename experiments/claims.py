"""Hold the claims of published papers against what can be computed: claims.csv and its figures."""

from adhesion_jax.command_line.claims import main
from adhesion_jax.command_line.command import run

if __name__ == "__main__":
    run(main)
