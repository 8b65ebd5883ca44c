"""Settings files of a command: where they are found, what overrides them, and what is said before they are run."""
