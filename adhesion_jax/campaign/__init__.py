"""Thousands of runs: what is asked for, seeds, chunks, devices and the store."""
