"""The same road as in SUMO, compiled: thousands of worlds at once, held equal to SUMO by tests."""
