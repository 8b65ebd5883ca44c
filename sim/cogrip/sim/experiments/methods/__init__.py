"""Methods of sharing an object over a network, compared under the same hands, networks and seeds.

`method` (what is compared), `hand` (the hands come to rest), `watch` (what is kept of a session), `measures` (what is read
of it, with units and formulas), `felt` (stiffness under a static load), `case` (one session, pure), `query` (all of
them), `table`, `latex`, `plots`, `page` (what is shown).
"""
