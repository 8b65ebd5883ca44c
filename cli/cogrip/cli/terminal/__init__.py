"""Terminal output: consoles, tables that fit, errors in one line."""
