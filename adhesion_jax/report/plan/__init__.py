"""The report of a plan: tables, words and the map."""
