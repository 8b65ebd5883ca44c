"""CRTK names for cogrip: `hold` drives an arm, `watch` publishes a session."""
