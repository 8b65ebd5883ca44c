"""Recordings played again: `verify` (the same cores, bit for bit), `what_if` (the same hands in another world)."""
