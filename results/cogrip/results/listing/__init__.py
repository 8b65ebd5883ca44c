"""A list of runs, each with its kind and its verdict in a line."""
