"""The arms the HD library drives: nominal records, what each calls itself, and how a device lowers its record.

Sources: forces, stiffness and damping as CHAI3D states them where it does; the rest are data sheet figures. Workspaces are
width x height x depth in the data sheets, so (depth, width, height) here.
"""

from dataclasses import dataclass, replace
from math import isfinite

from cogrip.devices.device import Capability, DeviceError, encoder_record

RATE_HZ = 1024  # rate in the records, a little above the servo's 1000 Hz: some 24 ticks a second then find nothing new
BUTTONS = 4  # buttons that the library tells of, whatever the stylus has
ALL_BUTTONS = (1 << BUTTONS) - 1
CAUTIOUS = "touch"  # model whose record serves where none is stated: the weakest


def _centred(size_m: tuple[float, ...]) -> tuple[tuple[float, float], ...]:
    return tuple((-0.5 * side, 0.5 * side) for side in size_m)


RECORDS = {
    model: replace(
        encoder_record(
            "openhaptics", model, _centred(size_m), force_n, limits, numbers, rate_hz=RATE_HZ, latency_ticks=1
        ),
        buttons=BUTTONS,
        gives_orientation=True,
    )
    for model, size_m, force_n, limits, numbers in (
        ("touch", (0.070, 0.160, 0.120), (3.3, 0.88), (400.0, 4.0), (5.5e-5, 0.045)),
        ("omni", (0.070, 0.160, 0.120), (3.3, 0.88), (700.0, 5.0), (5.5e-5, 0.045)),
        ("desktop", (0.120, 0.160, 0.120), (7.9, 1.75), (1000.0, 5.0), (2.3e-5, 0.045)),
        ("premium1.0", (0.127, 0.254, 0.178), (8.5, 1.4), (800.0, 5.0), (3e-5, 0.075)),
        ("premium1.5", (0.191, 0.381, 0.267), (8.5, 1.4), (800.0, 5.0), (3e-5, 0.075)),
        ("premium3.0", (0.406, 0.838, 0.584), (22.0, 3.0), (1000.0, 5.0), (2e-5, 0.159)),
    )
}
"""See `encoder_record`. The library's velocity is smoothed, it does not say how. What a frame read acts in the next frame,
wherever between them the loop's tick falls: a latency of one tick."""

_CALLS_ITSELF = (  # first match wins
    ("touch x", "desktop"),
    ("touch", "touch"),
    ("omni", "omni"),
    ("desktop", "desktop"),
    ("premium 1.0", "premium1.0"),
    ("premium 1.5", "premium1.5"),
    ("premium 3.0", "premium3.0"),
)


@dataclass(frozen=True, slots=True)
class Facts:
    """Facts that the library reports: model in its own words, largest forces [N], largest stiffness [N/mm]."""

    model: str
    peak_force_n: float
    continuous_force_n: float
    stiffness_npmm: float


def model_of(said: str) -> str | None:
    """The model a device that calls itself so is; None for one that nobody has described."""
    words = said.lower()
    return next((model for part, model in _CALLS_ITSELF if part in words), None)


def lowered(record: Capability, facts: Facts, stated: str, where: str) -> Capability:
    """`record` with every limit that the device puts lower put lower; none is ever raised.

    Raises DeviceError for a device of an unknown model, of another one than `stated`, or with limits that are no limits.
    """
    model = model_of(facts.model)
    if model is None:
        raise DeviceError(
            f"{where}: it calls itself {facts.model!r}, which is not known; known are {', '.join(RECORDS)}"
        )
    if stated and model != stated:
        raise DeviceError(
            f"{where}: it calls itself {facts.model!r}, that is model={model}, not {stated}; correct the key model"
        )
    for what, value in (
        ("largest force", facts.peak_force_n),
        ("largest continuous force", facts.continuous_force_n),
        ("largest stiffness", facts.stiffness_npmm),
    ):
        if not (isfinite(value) and value > 0.0):
            raise DeviceError(
                f"{where}: the library states a {what} of {value:g}, not above 0; update the vendor's driver"
            )
    peak = min(record.peak_force_n, facts.peak_force_n)
    return replace(
        record,
        peak_force_n=peak,
        continuous_force_n=min(record.continuous_force_n, facts.continuous_force_n, peak),
        stiffness_npm=min(record.stiffness_npm, 1000.0 * facts.stiffness_npmm),
    )
