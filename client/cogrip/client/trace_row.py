"""One row of a client's trace: the state of a core after a tick."""

from cogrip.client.core import ClientCore
from cogrip.client.safety import STATES

_STATE_NUMBER = {state: float(number) for number, state in enumerate(STATES)}
_SCALARS = (
    "time_s", "tick", "state", "late_us", "work_us", "skipped", "rtt_ms", "lost",
    "up_made_j", "down_used_j", "port_j", "work_j", "leak_j", "down_margin_j",
)  # fmt: skip
_VECTORS = ("position_m", "velocity_mps", "force_n", "wave_up", "wave_down", "object_m")


def columns(axes: int) -> tuple[str, ...]:
    """Column names: scalars, then each vector axis by axis (`position_m.0`); waves in sqrt(W)."""
    return _SCALARS + tuple(f"{name}.{axis}" for name in _VECTORS for axis in range(axes))


def row(core: ClientCore, time_s: float, late_us: float, work_us: float, skipped: int) -> tuple[float, ...]:
    """Values in the order of `columns`."""
    coupling = core.coupling
    margin = coupling.down_margin_j
    return (
        time_s, core.tick, _STATE_NUMBER[core.safety.state], late_us, work_us, skipped, core.rtt_ms,
        coupling.lost(), coupling.made_j, coupling.used_j, coupling.port_j, core.work_j, core.leak_j,
        0.0 if margin is None else margin,
        *core.position_m, *core.velocity_mps, *core.force_n, *coupling.forward, *coupling.returning,
        *coupling.object_state[: len(core.position_m)],
    )  # fmt: skip
