"""Runs side by side: the stretch that all have, and the `differences` of their numbers and settings."""
