"""The wiring of the commands, one a file."""
