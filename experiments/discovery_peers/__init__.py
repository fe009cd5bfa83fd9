"""General methods on the campaigns that the discovery is judged on."""
