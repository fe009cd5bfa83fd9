"""One measured record: the fit of every curve, its residual; and a log that is followed."""
