"""From residual to effect: what a law lacks, how sure that is, and what it costs to lack it."""
