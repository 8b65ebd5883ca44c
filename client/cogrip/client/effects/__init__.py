"""Haptic effects and fixtures that a client renders itself: docs/effects.md, theory 7.8."""
