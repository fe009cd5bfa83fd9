"""What published papers claim, held against what can be computed."""
