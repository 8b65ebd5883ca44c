"""A run read back: its folder, records, columns and traces, the values of its summary, and tables of them."""
