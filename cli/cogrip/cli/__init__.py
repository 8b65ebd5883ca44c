"""The `cogrip` command: a table of names to functions, imported when called."""
