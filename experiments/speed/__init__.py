"""How fast the methods are beside what else computes the same, all in one run on one machine."""
