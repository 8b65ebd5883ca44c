"""The passive wave line: waves of one direction over a network that delays, loses, repeats and reorders (SPEC.md 5).

sender          numbers the frames; repeats the newest R of them and the totals of all before in every datagram
receiver        keeps what arrives, counts the fate of every frame, and pops one wave a frame
jitter_buffer   decides at each pop whether to play, to repeat or to skip: a fixed playout delay, or one that adapts
concealment     proposes the wave for a missing frame, and the deficit compensation that is added to a wave
energy_ledger   bounds both proposals, so that no loss makes energy: sum(played^2) <= sum(sent^2) + energy credit
energy_sums     compensated summation for all ledgers, and the bound on its rounding
energy_reserve  newest and least reserve of a ledger, as both ends report it
"""
