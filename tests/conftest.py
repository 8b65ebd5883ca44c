"""Hypothesis for everyone: the same examples on every run, and no wall-clock deadline."""

from hypothesis import settings

settings.register_profile("cogrip", deadline=None, derandomize=True)
settings.load_profile("cogrip")
