"""Recordings played again: `verify` (the same cores, bit by bit), `what_if` (the same hands in another world)."""
