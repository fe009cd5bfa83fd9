"""How good an estimate can be, and how good it is."""
