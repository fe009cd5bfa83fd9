"""The main job, and what judges the package: `python -m experiments.NAME` in a clone."""
