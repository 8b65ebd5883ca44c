"""Settings of a coupling: [coupling] as it is written, and that of one seat, where "auto" has become a number to begin with."""

from collections.abc import Iterable
from math import sqrt
from typing import Annotated

import msgspec

from cogrip.machine.addition import add_floats
from cogrip.protocol.axes import GRIP_AXES
from cogrip.protocol.laws import decimation
from cogrip.protocol.laws import felt_stiffness as felt
from cogrip.protocol.settings import types
from cogrip.protocol.settings.coupling_kinds import COUPLING_KINDS, CouplingKind, Kind
from cogrip.protocol.settings.delays import Direction, PlayoutDelay, line_delay
from cogrip.protocol.settings.line_tuning import USUAL_NSPM, corner_hz, filter_lag_s, kept_tuning, tuning
from cogrip.protocol.settings.rates import Rates
from cogrip.protocol.settings.settable import LEAST_FILTER_HZ

GRIP_NSPM = 10.0  # impedance of a gripper where the settings give none


class CouplingBase(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Scheme, wave impedance, and the spring between proxy and object (theory sections 1 to 5)."""

    kind: Kind = "wave"
    impedance_nspm: types.Impedance | types.Auto = "auto"
    stiffness_npm: types.Stiffness = 1000.0
    damping_nspm: types.Damping = 10.0
    compensate: bool = False
    decimator: types.Decimator = "boxcar"
    lowpass_rad_s: Annotated[float, msgspec.Meta(ge=1e-3, le=1e5)] = 50.0
    server_step: types.ServerStep = "passive"
    encoder: types.Encoder = "displacement"
    # impedance of the axes that turn, where there are six
    rotational_impedance_nms: types.RotationalImpedance | msgspec.UnsetType = 0.02
    # impedance of a gripper, where there is one
    grip_impedance_nspm: types.Impedance | msgspec.UnsetType = msgspec.UNSET

    @property
    def traits(self) -> CouplingKind:
        """Properties of its kind."""
        return COUPLING_KINDS[self.kind]


class CouplingSection(CouplingBase, frozen=True, forbid_unknown_fields=True):
    """[coupling]: with the corner of the filter on both waves, and by what "auto" chooses (theory 7.1 to 7.3)."""

    wave_filter_hz: types.FilterHz | types.Auto = 0.0
    prefer: types.Prefer = "balanced"


class Coupling(CouplingBase, frozen=True, forbid_unknown_fields=True):
    """The coupling of one seat. Of the last two impedances a seat has one: that of its gripper, or of rotation."""

    impedance_nspm: types.Impedance = USUAL_NSPM  # impedance of a seat; with "auto" the one that it begins with
    rotational_impedance_nms: types.RotationalImpedance | msgspec.UnsetType = msgspec.UNSET

    def fits(self, axes: int) -> bool:
        """Return whether it has the impedance that a seat of so many axes needs, and not the other."""
        unset = self.grip_impedance_nspm is msgspec.UNSET, self.rotational_impedance_nms is msgspec.UNSET
        return unset == ((False, True) if axes == GRIP_AXES else (True, False))

    @property
    def further_impedance(self) -> float:
        """Impedance of the axes after the first three: b_r [N m s] of rotation, b_g [N s/m] of a gripper's opening."""
        own = (self.grip_impedance_nspm, self.rotational_impedance_nms)
        return next(each for each in own if each is not msgspec.UNSET)

    @property
    def length_scale(self) -> float:
        """Factor that turns the axes after the first three into lengths of the impedance b.

        The characteristic length l = sqrt(b_r / b) [m] of angles (theory 8.5), lambda = sqrt(b_g / b) of an opening (8.8).
        """
        return sqrt(self.further_impedance / self.impedance_nspm)


class LineTuning(msgspec.Struct, frozen=True, array_like=True):
    """Filter of one seat's waves, and what its client may change: array-like, as a welcome has no room for more keys."""

    # corner of the wave filter; with "auto" the one that the seat begins with; 0: no filter
    wave_filter_hz: types.FilterHz = 0.0
    auto_impedance: bool = False
    auto_filter: bool = False
    prefer: types.Prefer = "balanced"

    @property
    def live(self) -> bool:
        """True where the client may change anything."""
        return self.auto_impedance or self.auto_filter


def of_seat(
    asked: CouplingSection, playout: PlayoutDelay, directions: Iterable[Direction], rates: Rates, grips: bool
) -> tuple[Coupling, LineTuning]:
    """Return coupling and tuning of a seat: in place of "auto" stands what suits the delay that settings say.

    grips: its hand drives a gripper
    """
    values = msgspec.structs.asdict(asked)
    values["rotational_impedance_nms" if grips else "grip_impedance_nspm"] = msgspec.UNSET
    if values["grip_impedance_nspm"] is msgspec.UNSET and grips:
        values["grip_impedance_nspm"] = GRIP_NSPM
    prefer, b, corner = [values.pop(name) for name in ("prefer", "impedance_nspm", "wave_filter_hz")]
    auto = b == "auto", corner == "auto"
    # the other schemes keep what they begin with
    live = asked.traits.waves and asked.server_step == "passive"
    if any(auto):
        found = tuning(round_trip_s(playout, directions, rates) + rates.frame_s, prefer)
        follows = live and not asked.compensate
        b = (found if follows else kept_tuning(prefer)).impedance_nspm if auto[0] else b
        corner = corner_hz(found.filter_lag_s) if auto[1] else corner
    return Coupling(impedance_nspm=b, **values), LineTuning(corner, auto[0] and live, auto[1] and live, prefer)


def unfit_line(coupling: Coupling, line: LineTuning) -> str:
    """Return why the two do not fit together, "" where they do."""
    corner = line.wave_filter_hz
    if line.auto_filter and coupling.compensate:
        return (
            "coupling.compensate = true needs a filter that stays as it is; give wave_filter_hz a number in place of "
            '"auto", or set compensate to false'
        )
    if 0.0 < corner < LEAST_FILTER_HZ:
        return f"coupling.wave_filter_hz = {corner:g} is below {LEAST_FILTER_HZ:g} Hz; give more, or 0 for no filter"
    return ""


def round_trip_s(playout: PlayoutDelay, directions: Iterable[Direction], rates: Rates) -> float:
    """Return the delay of both lines together [s], playout included, as far as settings say it."""
    return add_floats(line_delay(playout, direction, rates).frames for direction in directions) * rates.frame_s


def line_compliance(coupling: Coupling, line: LineTuning, rates: Rates, round_trip_s: float) -> float:
    """Return C_line [m/N] of theory section 4 for delays of both directions together [s]."""
    lag = decimation.lag_s(coupling.decimator, rates.frame_s, coupling.lowpass_rad_s)
    lag += 2.0 * filter_lag_s(line.wave_filter_hz)
    if coupling.server_step == "paper":
        # P's force is one frame old: it moves the proxy back by F T_n / b (theory section 4)
        lag -= 2.0 * rates.frame_s
    return felt.line_compliance(coupling.impedance_nspm, round_trip_s, lag)
