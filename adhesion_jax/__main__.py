"""`python -m adhesion_jax` is `adhesion`."""

from adhesion_jax.command_line.program import main

if __name__ == "__main__":
    main()
