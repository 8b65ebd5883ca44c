"""Settings that both ends of one seat share, and what follows from them: the stiffness that its hand feels, its loop."""

from typing import Annotated

import msgspec
from msgspec.structs import replace

from cogrip.protocol.laws import felt_stiffness as felt
from cogrip.protocol.settings import types
from cogrip.protocol.settings.coupling import (
    Coupling,
    LineTuning,
    line_compliance,
    round_trip_s,
)
from cogrip.protocol.settings.hand import LINE_KEYS, NO_LIMIT, SPRING_KEYS, HandChange, WorkspaceLimit, unfit
from cogrip.protocol.settings.line_tuning import LEAST_NSPM, MOST_NSPM, Tuning, kept_tuning, tuning
from cogrip.protocol.settings.link_profile import LinkProfile
from cogrip.protocol.settings.object_kinds import kind_of
from cogrip.protocol.settings.rates import Rates
from cogrip.protocol.settings.sections import MOST_PEOPLE, Object, Playout
from cogrip.protocol.settings.tool_frame import ToolFrame
from cogrip.protocol.settings.types import Name, Seconds, Seed, Side


class SeatSettings(msgspec.Struct, frozen=True, array_like=True):
    """Settings that a seat's two ends share: sent in the welcome, bound by its digest."""

    room: Name
    user: Name
    seat: types.SeatNumber
    seed: Seed
    seconds: Seconds
    rates: Rates
    coupling: Coupling
    rendered_npm: types.Rendered  # K of the spring that the server integrates: [coupling]'s, or the compensated K'
    object: Object
    side: Side
    playout: Playout
    up: LinkProfile
    down: LinkProfile
    line: LineTuning = LineTuning()
    people: Annotated[int, msgspec.Meta(ge=1, le=MOST_PEOPLE)] = 1  # number of seats of the room
    tool: ToolFrame | None = None  # frame of the tool; None: it moves as the hand does
    workspace_limit: WorkspaceLimit = NO_LIMIT
    gravity_compensation: bool = False

    def __post_init__(self) -> None:
        if not self.coupling.fits(self.object.axes):
            raise ValueError(
                f"a seat of {self.object.axes} axes needs the impedance of its gripper, or of turning, alone"
            )

    @property
    def hand_change(self) -> HandChange:
        """The change that says what holds of this seat's hand as its session begins, but for a clutch that its button holds."""
        frame = self.tool or ToolFrame()
        return HandChange(
            frame.position_scale,
            frame.force_scale,
            frame.rotation,
            False,
            self.workspace_limit,
            self.gravity_compensation,
        )

    @property
    def damper_nspm(self) -> float:
        """Damping that the coupling itself asks of a device [N s/m]."""
        damping: float = getattr(self.coupling, self.coupling.traits.damper.key)
        return damping

    @property
    def side_sign(self) -> float:
        """Direction in which this person pushes along the first axis: +1 from the left, -1 from the right."""
        return 1.0 if self.side == "left" else -1.0

    @property
    def one_sided(self) -> bool:
        """True where the contact can only push (theory section 3.4)."""
        return kind_of(self.object.kind).one_sided

    @property
    def asked_npm(self) -> float | None:
        """K that was asked for, at the hand; None where no spring stands between a person and the object."""
        spring = self.coupling.traits.local or kind_of(self.object.kind).plain
        return self.force_scale * self.coupling.stiffness_npm if spring else None

    @property
    def force_scale(self) -> float:
        """s: stiffness at the hand by that at the tool."""
        return self.tool.force_scale if self.tool else 1.0

    @property
    def local_contact(self) -> str | None:
        """Kind of object with which the client renders contact itself; None where the line does it all."""
        return self.object.kind if self.coupling.traits.local else None

    @property
    def copy_kg(self) -> float:
        """Mass of a client's own copy of a free object, as much as the server keeps where everybody is there; 0 without one."""
        traits = kind_of(self.object.kind)
        copied = self.coupling.traits.local and not (traits.fixed or traits.scene)
        return self.object.mass_kg / (self.people + 1) if copied else 0.0

    @property
    def holds_still(self) -> bool:
        """True where a hand can press on what nobody moves: the stiffness that it feels is measured there."""
        kind = self.object.kind
        return kind_of(kind).fixed or (self.coupling.traits.local and kind_of(kind).scene)

    @property
    def adapts_stiffness(self) -> bool:
        """True where the server adapts the spring to the measured loop (docs/decisions/0012-measured-delay.md)."""
        coupling = self.coupling
        return coupling.compensate and coupling.traits.felt_through_waves and coupling.server_step == "passive"

    def unfit_change(self, change: HandChange) -> str:
        """Return why this seat cannot have a change while its session runs, "" where it can."""
        if why := unfit(change, self.object.axes):
            return why
        coupling, kind = self.coupling, self.coupling.kind
        given = change.given
        if line := [key for key in LINE_KEYS if key in given]:
            if not (coupling.traits.waves and coupling.server_step == "passive"):
                return f'{line[0]} is of a line of waves, and this room has coupling.kind = "{kind}", {coupling.server_step}'
            if not LEAST_NSPM <= coupling.impedance_nspm <= MOST_NSPM:
                return (
                    f"the line began with b = {coupling.impedance_nspm:g} N s/m, outside of the {LEAST_NSPM:g} to "
                    f"{MOST_NSPM:g} in which it can change; restart the room with one between them"
                )
            if coupling.compensate and change.wave_filter_hz is not None:
                return "coupling.compensate needs a filter that stays as it is; restart the room without it"
        if spring := [key for key in SPRING_KEYS if key in given]:
            if not (coupling.traits.felt_through_waves and kind_of(self.object.kind).plain):
                return (
                    f'{spring[0]} is of a spring that the server integrates, and with coupling.kind = "{kind}" and '
                    f'object.kind = "{self.object.kind}" there is none that can change'
                )
            if coupling.server_step != "passive":
                return f'{spring[0]} cannot change with coupling.server_step = "{coupling.server_step}": nothing pays for it'
        return ""

    def changed(self, change: HandChange) -> "SeatSettings":
        """Return the seat with a change of its line and its spring; itself where that is nothing."""
        if not change.of_line():
            return self
        coupling, line, rendered = self.coupling, self.line, self.rendered_npm
        if isinstance(change.impedance_nspm, float):
            coupling = replace(coupling, impedance_nspm=change.impedance_nspm)
        if isinstance(change.wave_filter_hz, float):
            line = replace(line, wave_filter_hz=change.wave_filter_hz)
        if change.impedance_nspm is not None:
            line = replace(line, auto_impedance=change.impedance_nspm == "auto")
        if change.wave_filter_hz is not None:
            line = replace(line, auto_filter=change.wave_filter_hz == "auto")
        if change.prefer is not None:
            line = replace(line, prefer=change.prefer)
        if change.damping_nspm is not None:
            coupling = replace(coupling, damping_nspm=change.damping_nspm)
        if change.stiffness_npm is not None:
            coupling, rendered = replace(coupling, stiffness_npm=change.stiffness_npm), change.stiffness_npm
        seat = replace(self, coupling=coupling, line=line, rendered_npm=rendered)
        if not seat.adapts_stiffness:
            return seat
        compliance = seat.line_compliance(self.loop_s / self.rates.frame_s)
        return replace(seat, rendered_npm=felt.reachable_stiffness(coupling.stiffness_npm, compliance))

    def at_impedance(self, impedance_nspm: float) -> "SeatSettings":
        """Return the seat with b in use: a compensated spring is that of the line with this b."""
        seat = replace(self, coupling=replace(self.coupling, impedance_nspm=impedance_nspm))
        if impedance_nspm == self.coupling.impedance_nspm or not self.adapts_stiffness:
            return seat
        compliance = seat.line_compliance(self.loop_s / self.rates.frame_s)
        return replace(seat, rendered_npm=felt.reachable_stiffness(self.coupling.stiffness_npm, compliance))

    def tuning_on(self, loop_s: float, carried_nspm: float) -> Tuning:
        """Return what "auto" chooses on a loop of this time and a device that carries so much [N s/m]."""
        if self.coupling.compensate:
            return kept_tuning(self.line.prefer, carried_nspm)
        return tuning(loop_s, self.line.prefer, carried_nspm)

    @property
    def loop_s(self) -> float:
        """Loop time as the settings say it, playout delay included [s]."""
        return round_trip_s(self.playout, (self.up, self.down), self.rates) + self.rates.frame_s

    def line_compliance(self, loop_frames: float) -> float:
        """Return C_line [m/N] of theory section 4 for a measured loop of `loop_frames` network frames.

        The loop counts the frames from a forward wave's own frame to the frame in which its answer is applied: 2d + 1 for d
        frames of delay in each direction.
        """
        return line_compliance(self.coupling, self.line, self.rates, (loop_frames - 1.0) * self.rates.frame_s)

    def predicted_stiffness(self, loop_frames: float, late_frames: float = 0.0) -> float | None:
        """Return K_hand [N/m] of theory section 4 for a measured loop; None without waves or without a spring, and in scenes.

        late_frames: age of the device's samples, and the line's position deficit [frames of its wave]: both make the line
        softer, and no server knows of them.
        """
        if self.coupling.traits.local and kind_of(self.object.kind).fixed:
            return self.force_scale * self.coupling.stiffness_npm
        if not self.coupling.traits.felt_through_waves or not kind_of(self.object.kind).plain:
            return None
        rendered = self.rendered_npm
        if self.adapts_stiffness:
            rendered = felt.reachable_stiffness(self.coupling.stiffness_npm, self.line_compliance(loop_frames))
        return self.force_scale * felt.felt_stiffness(rendered, self.line_compliance(loop_frames + late_frames))
