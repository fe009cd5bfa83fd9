"""The report of a discovery: its files, tables, figures and sentences."""
