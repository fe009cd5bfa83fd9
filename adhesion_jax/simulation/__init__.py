"""Simulated measurements that share no idea with the search they are to test."""
