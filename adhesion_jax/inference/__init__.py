"""The mean of measured runs by weighted robust least squares, and what is known of it."""
