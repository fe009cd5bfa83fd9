"""A log that online methods have followed: its figure, and its words."""
