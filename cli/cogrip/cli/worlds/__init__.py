"""Commands on worlds."""
