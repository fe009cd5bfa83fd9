"""What is fitted: the likelihood of a curve with its effects, and of their noise."""
