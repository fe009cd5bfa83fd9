"""What a measurement would tell of the peak: largest slip, number of samples, and noise."""
