"""What stands beside the search for effects: a second opinion on the residual it leaves."""
