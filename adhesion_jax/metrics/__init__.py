"""Bounds on the accuracy of estimates, and the accuracy that was reached."""
