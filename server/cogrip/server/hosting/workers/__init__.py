"""Rooms over several processes: a front process with the public port and the tokens, workers with the rooms."""
