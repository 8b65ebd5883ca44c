"""Commands that run a session: demo, serve, join, lab, relay, and their settings."""
