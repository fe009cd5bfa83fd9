"""Tables, words and the figure of one measured record."""
