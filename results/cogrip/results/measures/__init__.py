"""Measures of one run (docs/measures.md): `columns` (what they are taken from), `motion`, `interaction`, and the `registry`."""
