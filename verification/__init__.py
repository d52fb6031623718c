"""Proves the safety argument of ``strict``, and searches for collisions under the safety checks.

The argument is stated in ``drl_av/safety/strict.py``. The wheel holds the programs that measure a
driver or a check of the user: ``crash_rate``, ``own_hits``, ``falsify`` and ``approaches``.
"""
