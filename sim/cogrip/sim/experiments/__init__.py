"""Experiments: many sessions or models, spread over worker processes and kept case by case."""
