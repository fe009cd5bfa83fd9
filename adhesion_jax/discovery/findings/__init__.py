"""What is told of a search: findings, alternatives, cautions, intervals."""
