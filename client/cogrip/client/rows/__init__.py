"""Arithmetic of rows, one number an axis, that all of the client uses: sizes, delays, parts, springs."""
