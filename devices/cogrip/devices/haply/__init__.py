"""Haply's planar arms (2DIY, Pantograph) over hAPI, whose firmware has no watchdog."""
