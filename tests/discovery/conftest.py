"""The fits of the discovery run longer than they compile: not on the level 0 of other tests."""

from adhesion_jax.discovery.model.levenberg_marquardt import fit

fit.options["xla_backend_optimization_level"] = "1"
