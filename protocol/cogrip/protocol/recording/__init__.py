"""Recordings: what went into the cores of a run and what came out of them, as MCAP files of JSON messages.

Reading order: `records` (the messages, one struct a topic), `schema` (their JSON schemas), `sink` (where messages go),
`writer` with `summary`, and `reader` (the file), `header` (what a file says of itself).
"""
