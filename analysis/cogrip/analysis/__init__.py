"""Analysis before anybody touches: the session as one linear map of a network frame, and what follows from it.

Reading order: in `linear` the modules `linear_session` (its numbers), `state_space` (blocks), `client_blocks` and
`server_blocks` (both ends), `lifted_model` (the closed loop, P eq. 36), `rigid_motion` (its eigenvalues at 1), `stability`,
`region` and `boundary`, and by itself `decimation_passivity`; then `feel` and `advice`.
"""
