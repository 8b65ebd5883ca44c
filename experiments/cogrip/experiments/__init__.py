"""Experiments: many sessions or models, spread over worker processes, kept case by case in a folder, resumed.

`experiment` (what the runner needs of one), `runner`, `folder`, `worker_pool` and `ray_cluster` (the only modules here with
processes); `sweep` (a grid of settings), `methods` (a comparison of coupling schemes) and `study` (trials of people) are the
kinds.
"""
