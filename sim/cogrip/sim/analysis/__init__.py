"""Know before you touch: the session as one linear map a network frame, and what follows from it.

Reading order: `delays` (milliseconds to frames), `state_space` (blocks), `client_blocks` and `server_blocks` (what stands
at the two ends), `lifted_model` (all of it closed, P eq. 36), `rigid_motion` (its eigenvalues at 1), `stability` and
`region`, `feel`, `advice`. `decimation_passivity` stands by itself.
"""
