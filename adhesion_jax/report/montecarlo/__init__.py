"""Tables and figures of a Monte Carlo campaign."""
