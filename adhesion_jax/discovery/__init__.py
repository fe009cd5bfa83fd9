"""Discovery: which effects a law lacks in measured runs, how surely, and what they are worth."""
