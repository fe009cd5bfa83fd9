"""What is told of a discovery."""
