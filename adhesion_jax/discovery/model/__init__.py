"""What is fitted: a curve with effects and the noise of the data, by maximum likelihood."""
