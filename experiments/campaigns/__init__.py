"""Simulated campaigns with planted effects, independent of the search that they test."""
