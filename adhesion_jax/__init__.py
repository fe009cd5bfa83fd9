"""Identification of wheel-rail adhesion curves, and how well any method can know them."""
