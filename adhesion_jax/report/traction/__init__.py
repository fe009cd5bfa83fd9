"""The report of a traction system: its table, its figures and the page that shows both."""
