"""One module a command; each only wires the package together."""
