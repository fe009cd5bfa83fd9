"""What is reported of a search: effects, alternatives, cautions, intervals."""
