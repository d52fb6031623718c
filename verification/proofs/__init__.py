"""The safety argument of ``drl_av/safety/strict.py`` as lemmas over exact real numbers, for Z3."""
