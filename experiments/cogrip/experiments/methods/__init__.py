"""Comparison of coupling schemes ("methods") under the same hands, networks and seeds.

`method` (what is compared), `tasks` (what two people do), `hand` (hands that come to rest), `measures` (units and formulas),
`case` (one session), `query` (all of them), `table`, `latex`, `looks`, `rows`, `plots`, `trace_plot`, `report` (the results).
"""
