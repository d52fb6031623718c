"""What one does with a driver."""

DENSITIES = (1, 5, 10, 15, 20, 25, 30)
"""Numbers of vehicles that the published tables use."""
