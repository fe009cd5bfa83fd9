"""Claims of published papers, compared with the numbers computed here."""
