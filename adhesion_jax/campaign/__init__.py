"""Thousands of runs: configuration, seeds, tiles, worker processes and the store."""
