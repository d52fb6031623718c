"""Proves the safety argument of ``strict``, and searches for collisions under the safety checks.

The argument is stated in ``drl_av/safety/strict.py``; this package is not part of the wheel.
"""
