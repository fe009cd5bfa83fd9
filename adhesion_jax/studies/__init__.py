"""Studies that judge the methods: claims of papers, a baseline, the discovery, other methods."""
