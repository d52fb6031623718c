"""The argument of ``drl_av/safety/strict.py`` as lemmas over exact reals, which Z3 proves."""
