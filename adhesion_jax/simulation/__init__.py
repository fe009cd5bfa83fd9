"""Simulated measurements whose truth is known."""
