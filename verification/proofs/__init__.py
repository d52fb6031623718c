"""States the safety argument of ``drl_av/safety/strict.py`` as lemmas over exact reals for Z3."""
