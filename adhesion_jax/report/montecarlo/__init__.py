"""What is told of a Monte Carlo campaign."""
