"""Puts this folder on the import path, so that every room's tests find ``worlds``."""

from hypothesis import settings

settings.register_profile("drl_av", deadline=None)
settings.load_profile("drl_av")
