"""Know before you touch: the session as one linear map a network frame, and what follows from it.

Reading order: `linear_session` (which numbers), `state_space` (blocks), `client_blocks` and `server_blocks` (what
stands at the two ends), `lifted_model` (all of it closed, P eq. 36), `rigid_motion` (its eigenvalues at 1),
`stability`, `region` and `boundary`; `feel`, `delay_budget` and, on the measuring side, `session_impedance`; `advice`
and `advice_change`. `decimation_passivity` stands by itself. `measures` names single numbers for sweeps.
"""
