"""Numerical solvers that know nothing of adhesion."""
