"""How often a discovery is right, over simulated sets.

Parts: nothing hidden, power over strength, confusion of effects, two at once (pair), random effects
that no catalogue has, and logs of a locomotive.
"""
