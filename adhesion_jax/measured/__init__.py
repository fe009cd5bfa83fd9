"""One measured record: the fit of every curve, and what it leaves over."""
