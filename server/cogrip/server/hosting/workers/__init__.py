"""Rooms over several processes: a front process with the public address and the tokens, workers with the rooms."""
