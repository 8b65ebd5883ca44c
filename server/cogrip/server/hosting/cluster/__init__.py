"""Rooms on many hosts, as actors of a Ray cluster (docs/scaling.md)."""
