"""Identification of wheel-rail adhesion curves, and how well any method can know them."""

from adhesion_jax import runtime as runtime  # first: it sets the flags jax starts with
