"""Judgements of a run, in code and in sentences."""
