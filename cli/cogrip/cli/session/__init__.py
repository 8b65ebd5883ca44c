"""Commands that run a session: demo, serve, join, relay, lab, and their settings."""
