"""Experiments with people: a plan of trials, each a session, with participants, orders, questions and thresholds.

`study_file` (the TOML schema), `orders` and `staircase` (which condition comes next), `plan` (trials, from what is finished),
`trial` (state machine of one trial), `journal` (the study's folder), `conductor` (one trial after the other),
`laboratory_trial` and `simulated` (sessions and participants in virtual time), `table` and `figures` (what comes out).
"""
