"""The TOML schema of every command: types, bounds, defaults (docs/settings.md).

Units are in the names. `resolve` turns the raw table into `Settings` or raises SettingsError, which names the setting, its
value, the bound and the cure. `seat_settings` returns what one user's client and seat must agree on.
"""

from collections import Counter
from collections.abc import Mapping
from typing import Annotated, Any, Literal

import msgspec
from msgspec.structs import replace

from cogrip.protocol import felt_stiffness as felt
from cogrip.protocol import setting_types as types
from cogrip.protocol.coupling_settings import (
    Coupling,
    CouplingSection,
    LineTuning,
    line_compliance,
    of_seat,
    round_trip_s,
    unfit_line,
)
from cogrip.protocol.effects import MOST_EFFECTS, TANK_MJ, EffectSection, EffectTank, unfit_section
from cogrip.protocol.hand_settings import NO_LIMIT, HandSection, WorkspaceLimit
from cogrip.protocol.line_tuning import Tuning, kept_tuning, tuning
from cogrip.protocol.link_profile import Link, LinkProfile, check_link
from cogrip.protocol.network_rate import best_rate, stated_frame_s, take_auto
from cogrip.protocol.object_fit import unfit_object
from cogrip.protocol.object_kinds import KindText, LocalKindText, kind_of, shared_kind
from cogrip.protocol.rates import DeviceHz, Hz, Rates, misfit
from cogrip.protocol.setting_types import MOST_RENDERED_NPM, PLACES, POSE_AXES, Name, Seconds, Seed, Side
from cogrip.protocol.settings_table import SettingsError, copied, override, readable, refuse_unknown
from cogrip.protocol.task import Task
from cogrip.protocol.tool_frame import ToolFrame

HUMAN_POWER_W = 10.0  # mean power of a hand on a hand-sized device (docs/security.md)
REMOTE_FORCE_N = 40.0  # peak force that a record may claim: as strong as the arms on the market
REMOTE_SPEED_MPS = 4.0
REMOTE_TORQUE_NM = 3.0
REMOTE_SPEED_RADPS = 40.0
REMOTE: Mapping[str, float] = {
    "force_n": REMOTE_FORCE_N, "speed_mps": REMOTE_SPEED_MPS, "torque_nm": REMOTE_TORQUE_NM, "speed_radps": REMOTE_SPEED_RADPS,
}  # fmt: skip
"""Bounds of device records, by field of `Admission`, where it sets none."""
MOST_PEOPLE = 256
ONLY_USER = "anna"  # name of the person where a file names no users


class RatesSection(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """[rates]: of the device loop, and of network and object."""

    device_hz: DeviceHz = 1024
    network_hz: Hz = 128


class Object(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The virtual object, as both ends know it."""

    kind: KindText = "cube"
    mass_kg: types.Mass = 0.2
    damping_nspm: types.Damping = 0.0
    axes: Annotated[int, msgspec.Meta(ge=1, le=POSE_AXES)] = 1


class ObjectSection(Object, frozen=True, forbid_unknown_fields=True):
    """[object]: of a scene also its files, start and steps a frame, which are the server's own: no welcome carries them."""

    # kind of the object; with the folder of a file, made absolute where settings are loaded
    kind: LocalKindText = "cube"
    file: str = ""  # path of an MJCF or URDF file; made absolute where settings are loaded
    folder: str = ""  # folder outside of which no file of a scene is read, absolute as `file`; "" the folder of `file`
    keyframe: str = ""  # keyframe in which a scene begins; "" as its bodies stand
    ctrl: tuple[float, ...] = ()  # constant control of each actuator of a scene; () as the keyframe has it, else 0
    substeps: Annotated[int, msgspec.Meta(ge=1, le=64)] = 4

    def shared(self, axes: int) -> Object:
        """Return what both ends of a seat of `axes` axes know."""
        return Object(shared_kind(self.kind), self.mass_kg, self.damping_nspm, axes)


class Playout(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """[playout]: playout delay, redundancy, credit and concealment of both lines (SPEC.md 5)."""

    frames: Annotated[int, msgspec.Meta(ge=0, le=256)] | Literal["auto"] = "auto"  # auto: adapted to the jitter
    late: Annotated[float, msgspec.Meta(ge=0.0, le=0.2)] = 0.01  # rate of late frames that "auto" aims at
    redundancy: Annotated[int, msgspec.Meta(ge=1, le=32)] = 8
    tank_mj: Annotated[float, msgspec.Meta(ge=0.0, le=1e3)] = 80.0
    concealment: types.Concealed = "elastic"  # strategy for frames that are missing


class Admission(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Admission control and limits of seats. The server's own: no welcome carries it."""

    observers: Annotated[int, msgspec.Meta(ge=0, le=64)] = 8  # most observers of this room at once
    # most seats that one token holds at once, in all rooms
    seats_per_token: Annotated[int, msgspec.Meta(ge=1, le=65536)] = 8
    devices: Literal["any", "listed"] = "any"  # listed: a seat takes the device named for it in [[users]] alone
    # Bounds of device records: a record that claims more is refused, one without a bound gets this one. None: any; in an
    # encrypted room the bounds of `for_remote_clients`.
    force_n: types.RecordBound | None = None
    speed_mps: types.RecordBound | None = None
    torque_nm: types.RecordBound | None = None
    speed_radps: types.RecordBound | None = None
    power_w: types.Watts = HUMAN_POWER_W  # mean power of a seat; 0: F V of its record


class User(HandSection, frozen=True, forbid_unknown_fields=True):
    """One seat. The fields that are None are [coupling]'s; device_hz [rates]'s."""

    name: Name = ""
    device: str = "sim:phantom"
    hand: str = "reach"
    side: Side = "left"
    device_mass_kg: types.Mass = 0.1
    device_damping_nspm: types.Damping = 0.0
    impedance_nspm: types.Impedance | types.Auto | None = None
    wave_filter_hz: types.FilterHz | types.Auto | None = None
    prefer: types.Prefer | None = None
    stiffness_npm: types.Stiffness | None = None
    damping_nspm: types.Damping | None = None
    decimator: types.Decimator | None = None
    encoder: types.Encoder | None = None
    compensate: bool | None = None
    device_hz: DeviceHz | None = None
    power_w: types.Watts | None = None  # mean power of this person's seat; None: [admission]'s
    tool: str = ""  # body of a scene that this person moves; "" one is added; PINCH: with a gripper
    # orientation of that tool: "driven" by the hand; "" driven where the room has six axes, else as the body's joints have it
    orientation: types.Orientation = ""
    rotational_impedance_nms: types.RotationalImpedance | None = None
    grip_impedance_nspm: types.Impedance | None = None

    @property
    def grips(self) -> bool:
        """True where the hand drives a gripper, whose opening is an axis of its line."""
        return self.tool.partition(":")[0] == types.PINCH


class Settings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """All settings of a room."""

    name: Name = "session"
    seed: Seed = 1
    seconds: Seconds = 10.0
    rates: RatesSection = RatesSection()
    coupling: CouplingSection = CouplingSection()
    object: ObjectSection = ObjectSection()
    task: Task = Task()
    link: Link = Link()
    playout: Playout = Playout()
    admission: Admission = Admission()
    users: Annotated[tuple[User, ...], msgspec.Meta(min_length=1, max_length=MOST_PEOPLE)] = (User(name=ONLY_USER),)
    effects: Annotated[tuple[EffectSection, ...], msgspec.Meta(max_length=MOST_EFFECTS)] = ()
    # energy of each person that vibration and texture may draw, and that fixtures cost
    effect_tank_mj: EffectTank = TANK_MJ


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
        spring = self.coupling.traits.local or kind_of(self.object.kind).spring
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
        return self.object.mass_kg / (self.people + 1) if self.local_contact == "faces" else 0.0

    @property
    def holds_still(self) -> bool:
        """True where a hand can press on what nobody moves: the stiffness that it feels is measured there."""
        kind = self.object.kind
        return kind_of(kind).fixed or (self.coupling.traits.local and kind == "scene")

    @property
    def adapts_stiffness(self) -> bool:
        """True where the server adapts the spring to the measured loop (docs/decisions/0012-measured-delay.md)."""
        coupling = self.coupling
        return coupling.compensate and coupling.traits.felt_through_waves and coupling.server_step == "passive"

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
        if not self.coupling.traits.felt_through_waves or not kind_of(self.object.kind).spring:
            return None
        rendered = self.rendered_npm
        if self.adapts_stiffness:
            rendered = felt.reachable_stiffness(self.coupling.stiffness_npm, self.line_compliance(loop_frames))
        return self.force_scale * felt.felt_stiffness(rendered, self.line_compliance(loop_frames + late_frames))


def resolve(table: Mapping[str, Any], overrides: Mapping[str, Any] | None = None) -> Settings:
    """Return settings from a TOML table and `--set` overrides ({"coupling.stiffness_npm": 500.0}). Raises SettingsError."""
    merged = copied(table)
    if "link.profile" in (overrides or {}):  # another network: it replaces the whole one of the file
        merged.pop("link", None)
    for key, value in (overrides or {}).items():
        override(merged, key, value, ONLY_USER)
    automatic = take_auto(merged)
    refuse_unknown(merged, Settings)
    users = merged.get("users")
    for index, user in enumerate(users if isinstance(users, list) else ()):
        if isinstance(user, dict):
            user.setdefault("name", f"user{index + 1}")
    try:
        settings = msgspec.convert(merged, Settings)
    except msgspec.ValidationError as error:
        raise SettingsError(readable(str(error), merged, Settings)) from None
    if automatic:
        settings = replace(settings, rates=replace(settings.rates, network_hz=best_network_hz(settings)))
    _check_fit(settings)
    return settings


def best_network_hz(settings: Settings, frame_s: float | None = None) -> int:
    """Return what "auto" is where a frame takes the server this time [s]; None: what is stated."""
    device_hz = [user.device_hz or settings.rates.device_hz for user in settings.users]
    took_s = stated_frame_s(settings) if frame_s is None else frame_s
    return best_rate(device_hz, settings.object.axes, took_s, settings.playout, link_directions(settings))


def link_directions(settings: Settings) -> tuple[LinkProfile, LinkProfile]:
    """Return both directions of the link, up and down."""
    return settings.link.direction("up"), settings.link.direction("down")


def for_remote_clients(settings: Settings) -> Settings:
    """Return the settings of a room that other machines may join: device records have bounds in any case."""
    admission = settings.admission
    bounds = {name: bound for name, bound in REMOTE.items() if getattr(admission, name) is None}
    return replace(settings, admission=replace(admission, **bounds))


def coupling_asked(settings: Settings, user: User) -> CouplingSection:
    """Return [coupling] with this user's own values."""
    own = {name: getattr(user, name) for name in CouplingSection.__struct_fields__ if hasattr(user, name)}
    return replace(settings.coupling, **{name: value for name, value in own.items() if value is not None})


def coupling_of(settings: Settings, user: User) -> Coupling:
    """Return the coupling of this user's seat."""
    return tuned_coupling(settings, user)[0]


def tuned_coupling(settings: Settings, user: User) -> tuple[Coupling, LineTuning]:
    """Return the coupling of this user's seat, and the tuning of its line."""
    asked, rates = coupling_asked(settings, user), rates_of(settings, user)
    return of_seat(asked, settings.playout, link_directions(settings), rates, user.grips)


def not_passive(settings: Settings) -> str:
    """Return the settings by which a room is not passive, "" if none does that."""
    coupling = settings.coupling
    if not coupling.traits.passive:
        return f'coupling.kind = "{coupling.kind}"'
    if not coupling.traits.waves:
        return ""
    active = ['coupling.server_step = "paper"'] if coupling.server_step == "paper" else []
    decimators = {coupling_of(settings, user).decimator for user in settings.users}
    return ", ".join(active + [f'decimator = "{each}"' for each in ("lowpass", "none") if each in decimators])


def seat_axes(settings: Settings, user: User) -> int:
    """Return the number of axes of a user's seat: in a room of poses only the places, where the hand does not turn its tool.

    One more where it drives a gripper.
    """
    axes = types.GRIP_AXES if user.grips else settings.object.axes
    return axes if axes < POSE_AXES or user.orientation in ("", "driven") else PLACES


def rates_of(settings: Settings, user: User) -> Rates:
    """Return [rates] with this user's own device rate."""
    device_hz = settings.rates.device_hz if user.device_hz is None else user.device_hz
    return Rates(device_hz, settings.rates.network_hz)


def seat_settings(settings: Settings, seat: int) -> SeatSettings:
    """Return what user number `seat` and the server share. Raises SettingsError where compensation is out of reach."""
    user = settings.users[seat]
    coupling, line = tuned_coupling(settings, user)
    rates, (up, down) = rates_of(settings, user), link_directions(settings)
    if why := unfit_line(coupling, line):
        raise SettingsError(f"users.{seat} ({user.name}): {why}")
    rendered = coupling.stiffness_npm
    if coupling.compensate and coupling.traits.felt_through_waves:
        compliance = line_compliance(coupling, line, rates, round_trip_s(settings.playout, (up, down), rates))
        try:
            rendered = felt.compensated_stiffness(coupling.stiffness_npm, coupling.impedance_nspm, compliance)
        except felt.OutOfReachError as error:
            raise SettingsError(f"users.{seat} ({user.name}): {error}") from None
        if rendered > MOST_RENDERED_NPM:
            raise SettingsError(
                f"users.{seat} ({user.name}): coupling.compensate would render {rendered:.4g} N/m, more than "
                f"{MOST_RENDERED_NPM:g}: raise coupling.impedance_nspm, or ask for less stiffness"
            )
    return SeatSettings(
        settings.name, user.name, seat, settings.seed, settings.seconds, rates, coupling, rendered,
        settings.object.shared(seat_axes(settings, user)), user.side, settings.playout, up, down, line, len(settings.users),
        *hand_of(settings, seat), user.gravity_compensation,
    )  # fmt: skip


def hand_of(settings: Settings, seat: int) -> tuple[ToolFrame | None, WorkspaceLimit]:
    """Return the frame of this seat's tool, None where it moves as the hand does, and its limit. Raises SettingsError."""
    user = settings.users[seat]
    try:
        return user.tool_and_limit(seat_axes(settings, user))
    except ValueError as error:
        raise SettingsError(f"users.{seat} ({user.name}): {error}") from None


def _check_fit(settings: Settings) -> None:
    users = [(f"users.{place}", user.device_hz) for place, user in enumerate(settings.users)]
    for key, device_hz in (("rates", settings.rates.device_hz), *users):
        if device_hz and (why := misfit(device_hz, settings.rates.network_hz, f"{key}.device_hz")):
            raise SettingsError(why)
    ((name, times),) = Counter(user.name for user in settings.users).most_common(1)
    if times > 1:
        raise SettingsError(f"users: the name {name!r} stands twice; give every user a name of their own")
    kind = settings.coupling.kind
    if kind != "wave" and settings.coupling.server_step == "paper":
        raise SettingsError(
            f'coupling.server_step = "paper" is a step of the wave scheme; with coupling.kind = "{kind}" leave it "passive"'
        )
    check_link(settings.link)
    compensated = [user.name for user in settings.users if coupling_of(settings, user).compensate]
    if why := unfit_object(settings, compensated):
        raise SettingsError(why)
    for place, effect in enumerate(settings.effects):
        if why := unfit_section(effect, settings.object.axes):
            raise SettingsError(f"effects.{place}: {why}")
        if unknown := set(effect.users) - {user.name for user in settings.users}:
            raise SettingsError(f"effects.{place}.users: there is no user {min(unknown)!r}; name one of [[users]]")
    for seat in range(len(settings.users)):
        seat_settings(settings, seat)
