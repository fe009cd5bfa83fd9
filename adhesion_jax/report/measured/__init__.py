"""What is told of one measured record."""
