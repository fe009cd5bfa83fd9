"""How often the intervals of an identification hold the truth."""
