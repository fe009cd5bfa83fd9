"""One measured record: the fit of every curve, and the structure of its residual."""
