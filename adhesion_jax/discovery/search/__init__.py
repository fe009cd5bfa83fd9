"""The search: which effects are tried, accepted, refined, removed and doubted."""
