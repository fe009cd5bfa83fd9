"""The traction loop: plants, and what is put around them."""
