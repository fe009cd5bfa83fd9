"""What is told of what judges."""
