"""What judges: claims of papers, the baseline, the discovery over many sets, other methods."""
