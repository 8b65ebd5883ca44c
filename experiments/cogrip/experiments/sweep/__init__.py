"""Sweeps: sessions, or linear models, over a grid of settings.

`grid` (what is varied), `measures` (what is read), `query` (both, checked, and one case of it), `picture`.
"""
