"""Families of devices: one module for each, which makes drivers of parts and lines for an address."""
