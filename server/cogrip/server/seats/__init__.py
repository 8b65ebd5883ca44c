"""Seats and observers of a room: who takes part, what each is told, and what each left behind."""
