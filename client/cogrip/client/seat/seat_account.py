"""The account of one seat, for the server and the summary."""

from msgspec.structs import replace

from cogrip.client.safety.limiter import Safety
from cogrip.client.seat.seated import SeatedClient
from cogrip.machine.tick_count import Percentiles, TickCount
from cogrip.protocol.texts import clipped
from cogrip.protocol.wire.accounts import LEFT, REASON_BYTES, SATURATED, ClientAccount, DelayAccount


def account_of(seat: SeatedClient, ticks: TickCount, rtt_ms: Percentiles, delay: DelayAccount) -> ClientAccount:
    """Return all that this end knows. ticks: of its loop, as its driver counted them."""
    coupling, ledger, safety, peaks = seat.coupling, seat.ledger, seat.safety, seat.peaks
    return ClientAccount(
        position_m=seat.tool_pose(),
        force_n=seat.wrench,
        peak_force_n=peaks.force_n,
        travel_m=peaks.travel_m,
        felt_stiffness_npm=_felt_npm(seat),
        predicted_stiffness_npm=_predicted_npm(seat),
        down_margin_j=coupling.down_margin_j,
        device_leak_j=ledger.least_leak_j,
        down=ledger.count(),
        rtt_ms=rtt_ms,
        ticks=ticks,
        unstable=bool(safety.unstable),
        state=safety.state,
        reason=clipped(seat.session.failed or _why(safety), REASON_BYTES),
        peak_step_n=peaks.step_n,
        playout=ledger.playout_account(),
        delay=delay,
        device=replace(seat.port.account(), shake_n=seat.shaking.shake_n),
        down_reserve_j=ledger.down_reserve_j,
        peak_torque_nm=peaks.further,
        line=coupling.line_account(),
        effects=seat.effects.account(),
        incidents=(LEFT if safety.left else 0) + (SATURATED if safety.saturated else 0),
    )


def _why(safety: Safety) -> str:
    """Return the gravest reason that safety gives: a fault as it was latched, else what went wrong first."""
    if safety.state == "fault":
        return safety.reason
    return safety.unstable or safety.saturated or safety.left or safety.reason


def _predicted_npm(seat: SeatedClient) -> float | None:
    """Return the stiffness that the hand is to feel over the loop as measured [N/m]; None where there is no model."""
    if (loop := seat.coupling.loop_frames()) is None:
        return None
    more = seat.late_frames + seat.rest.mean_deficit_frames()
    now = replace(seat.coupling.seat_now(), tool=seat.settings.tool)
    return now.predicted_stiffness(loop, more)


def _felt_npm(seat: SeatedClient) -> float | None:
    """Return the stiffness that the hand felt at rest [N/m]; None where it was not measured."""
    found = seat.rest.stiffness_npm()
    return None if found is None else seat.settings.force_scale * found
