"""The traction loop: plants, sensors, observers, seekers and controllers."""
