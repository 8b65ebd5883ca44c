"""Account of a client: all that it knows at the end of a session."""

from __future__ import annotations

from typing import TYPE_CHECKING

from cogrip.protocol.accounts import ClientAccount, DelayAccount, Percentiles, TickCount
from cogrip.protocol.messages import clipped

if TYPE_CHECKING:
    from cogrip.client.core import ClientCore


def account_of(core: ClientCore, ticks: TickCount) -> ClientAccount:
    """The account of a core that has a seat. ticks: of its loop, as its driver counted them."""
    down, playout, reserve_j = core.line_account()
    return ClientAccount(
        position_m=core.position_m,
        force_n=core.force_n,
        peak_force_n=core.peak_force_n,
        travel_m=core.travel_m,
        felt_stiffness_npm=core.felt_stiffness,
        predicted_stiffness_npm=core.predicted_stiffness(),
        down_margin_j=core.down_margin_j,
        device_leak_j=core.least_leak_j,
        down=down,
        rtt_ms=Percentiles.of(core.rtt, 1e6),
        ticks=ticks,
        diverged=bool(core.diverged),
        state=core.safety.state,
        reason=clipped(core.session.failed or core.diverged or core.safety.reason),
        peak_step_n=core.peak_step_n,
        playout=playout,
        delay=_delay(core),
        device=core.port.account(),
        down_reserve_j=reserve_j,
    )


def _delay(core: ClientCore) -> DelayAccount:
    clock = core.session.clock
    offset_ns, uncertainty_ns = clock.offset_ns, clock.uncertainty_ns
    return DelayAccount(
        Percentiles.of(core.up, 1e6),
        Percentiles.of(core.down, 1e6),
        None if offset_ns is None else offset_ns * 1e-6,
        None if uncertainty_ns is None else uncertainty_ns * 1e-6,
    )
