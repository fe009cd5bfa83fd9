"""What each command does, one a file; each only wires the rooms together."""
