"""Simulated measurements, independent of the search that they test."""
