"""Comparison of coupling schemes ("methods") under the same hands, networks and seeds.

`method` (what is compared), `hand` (hands that come to rest), `trace` (what is recorded of a session), `measures` (units and
formulas), `felt` (stiffness under a static load), `case` (one session), `query` (all of them), `table`, `latex`, `looks`,
`rows`, `plots`, `trace_plot`, `report` (the results).
"""
