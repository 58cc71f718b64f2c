"""What the simulation of cloth and its slow twin share."""

GRAVITY = -9.81
"""Along y, m/s^2."""
ROUNDS = 8
"""Projections of lengths and collisions a step."""
