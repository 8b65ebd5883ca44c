"""Many sessions, or many linear models, over a grid of settings: spread over processes, kept cell by cell, resumed, drawn.

`grid` (what is varied), `measures` (what is read), `case` (one cell, pure), `local` and `ray_cluster` (where cells
run: the only modules here with processes), `folder` (what is kept), `picture`.
"""
