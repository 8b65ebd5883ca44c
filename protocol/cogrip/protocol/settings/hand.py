"""Settings of a person that can be changed while a session runs: their values, texts and bounds (`SPEC.md` section 3.17).

Those of the hand and its tool, of the line, and of the spring between the person and the object. A text is what stands behind
`cogrip set NAME key=` and in the settings: one parser for files, terminals and commands.
"""

from collections.abc import Mapping, Sequence
from typing import Annotated, Any, Literal, get_args

import msgspec
from msgspec.structs import asdict, replace

from cogrip.protocol.axes import PLACES
from cogrip.protocol.laws.rotations import UNTURNED, log
from cogrip.protocol.settings import types
from cogrip.protocol.settings.line_tuning import LEAST_NSPM, MOST_NSPM
from cogrip.protocol.settings.settable import (
    MOST_DAMPING_NSPM,
    MOST_STIFFNESS_NPM,
    Parser,
    choice_of,
    filter_of,
    number_of,
    read_pairs,
)
from cogrip.protocol.settings.tool_frame import (
    LEAST_SCALE,
    MOST_SCALE,
    Button,
    Part,
    Rotation,
    Scale,
    ToolFrame,
    rotation_of,
)

MOST_LIMIT_M = 10.0
LimitText = Annotated[str, msgspec.Meta(max_length=160)]
LimitNumber = Annotated[int, msgspec.Meta(ge=-10_000_000, le=10_000_000)]
"""Number of a workspace limit [um]: a welcome has no room for more bytes."""
LIMITS = 'write "none", "auto", "box X0 X1 Y0 Y1 Z0 Z1" or "sphere X Y Z R" [m]'


class WorkspaceLimit(msgspec.Struct, frozen=True, array_like=True):
    """Limit of a hand's workspace. numbers_um: of a box low and high of each axis, of a sphere its middle and radius.

    "auto" is the device's own workspace.
    """

    kind: Literal["none", "auto", "box", "sphere"] = "none"
    numbers_um: Annotated[tuple[LimitNumber, ...], msgspec.Meta(max_length=2 * PLACES)] = ()

    def __post_init__(self) -> None:
        numbers, kind = self.numbers_um, self.kind
        if kind == "box":
            fits = len(numbers) in (2, 4, 6) and all(a < b for a, b in zip(numbers[::2], numbers[1::2], strict=True))
            why = "needs low and high of each axis, the lower one first"
        elif kind == "sphere":
            fits, why = len(numbers) == PLACES + 1 and numbers[-1] > 0, "needs X Y Z and a radius above 0"
        else:
            fits, why = not numbers, "takes no numbers"
        if not fits:
            raise ValueError(f"a workspace limit {kind!r} {why}")

    @property
    def numbers_m(self) -> tuple[float, ...]:
        """Return the numbers in metres."""
        return tuple([number * 1e-6 for number in self.numbers_um])

    @property
    def text(self) -> str:
        """Return the limit as it is written [m]."""
        return " ".join([self.kind, *[f"{number:.7g}" for number in self.numbers_m]])


NO_LIMIT = WorkspaceLimit()
LineImpedance = Annotated[float, msgspec.Meta(ge=LEAST_NSPM, le=MOST_NSPM)]
"""Impedance b of a line that changes in a session [N s/m]: both ends bound it so (theory 7.3)."""


class HandChange(msgspec.Struct, frozen=True, array_like=True, forbid_unknown_fields=True):
    """Change of a person's settings; None: stays. A report has all of them, as they hold.

    rotation  unit quaternion w, x, y, z
    clutch    a change: whether it is to be held, whatever its button does; a report: whether it is
    impedance_nspm, wave_filter_hz, prefer  of the line; None in the report of a client without waves
    stiffness_npm, damping_nspm             of the spring, which the server integrates: a client takes note of them
    """

    position_scale: Scale | None = None
    force_scale: Scale | None = None
    rotation: Annotated[tuple[Part, ...], msgspec.Meta(min_length=4, max_length=4)] | None = None
    clutch: bool | None = None
    workspace_limit_m: WorkspaceLimit | None = None
    gravity_compensation: bool | None = None
    impedance_nspm: LineImpedance | types.Auto | None = None
    wave_filter_hz: types.FilterHz | types.Auto | None = None
    prefer: types.Prefer | None = None
    stiffness_npm: types.Stiffness | None = None
    damping_nspm: types.Damping | None = None

    def __post_init__(self) -> None:
        if self.rotation is not None:
            self.frame()

    def frame(self, before: ToolFrame | None = None) -> ToolFrame:
        """Return the frame of a tool after this change. Raises ValueError for a rotation that is none."""
        own = {name: getattr(self, name) for name in ("position_scale", "force_scale", "rotation")}
        return replace(before or ToolFrame(), **{name: value for name, value in own.items() if value is not None})

    def of_line(self) -> dict[str, Any]:
        """Return what is given of line and spring, by name."""
        return {name: value for name in (*LINE_KEYS, *SPRING_KEYS) if (value := getattr(self, name)) is not None}

    def of_spring(self) -> dict[str, Any]:
        """Return what is given of the spring, by name."""
        return {name: value for name in SPRING_KEYS if (value := getattr(self, name)) is not None}

    def after(self, before: "HandChange") -> "HandChange":
        """Return both as one: this one came later."""
        return replace(before, **self.given)

    @property
    def given(self) -> dict[str, Any]:
        """Return what is not None, by name."""
        return {name: value for name, value in asdict(self).items() if value is not None}

    @property
    def plain(self) -> dict[str, Any]:
        """Return what is not None as a summary has it."""
        limit = {"workspace_limit_m": self.workspace_limit_m.text} if self.workspace_limit_m else {}
        return {
            name: list(value) if isinstance(value, tuple) else value for name, value in (self.given | limit).items()
        }

    @property
    def text(self) -> str:
        """Return it as `key=value` for people."""
        return " ".join([f"{name}={_shown(value)}" for name, value in self.given.items()])

    def unlike(self, other: "HandChange") -> "HandChange":
        """Return what differs from `other`."""
        has = other.given
        return HandChange(**{name: value for name, value in self.given.items() if has.get(name) != value})

    def refused(self, report: "HandChange") -> list[str]:
        """Return the names of what a hand with this report does not go by."""
        return list(self.unlike(report).given)


UNSET = HandChange()
"""Change of nothing."""
UNCHANGED = HandChange(1.0, 1.0, UNTURNED, False, NO_LIMIT, False)
"""Report of a hand that moves its tool as it moves itself."""


def _shown(value: Any) -> str:
    if isinstance(value, bool):
        return "on" if value else "off"
    if isinstance(value, WorkspaceLimit):
        return f'"{value.text}"' if value.numbers_um else value.text
    if isinstance(value, tuple):
        return ",".join([f"{angle:.4g}" for angle in log(value)]) if value != UNTURNED else "none"
    return value if isinstance(value, str) else f"{value:g}"


def limit_of(text: str) -> WorkspaceLimit:
    """Return the workspace limit of a setting. Raises ValueError."""
    kind, *numbers = text.replace(",", " ").split() or [""]
    if kind not in ("none", "auto", "box", "sphere"):
        raise ValueError(f"workspace_limit_m = {text!r} is none: {LIMITS}")
    try:
        found = tuple([float(number) for number in numbers])
        if not all(abs(number) <= MOST_LIMIT_M for number in found):
            raise ValueError(f"a number is out of -{MOST_LIMIT_M:g} to {MOST_LIMIT_M:g} m")
        return WorkspaceLimit(kind, tuple([round(1e6 * number) for number in found]))  # type: ignore[arg-type]  # one of them
    except ValueError as error:
        raise ValueError(f"workspace_limit_m = {text!r}: {error}; {LIMITS}") from None


def _scale(key: str, text: str) -> float | Literal["auto"]:
    return number_of(key, text, LEAST_SCALE, MOST_SCALE)


def _switch(key: str, text: str) -> bool:
    if text not in ("on", "off"):
        raise ValueError(f'{key} = {text!r} is neither; write "on" or "off"')
    return text == "on"


def _rotation(key: str, text: str) -> tuple[float, ...]:
    words = text.replace(",", " ").split()
    if text == "none":
        return UNTURNED
    try:
        angles = [float(word) for word in words]
    except ValueError:
        return rotation_of(text)
    if len(angles) != PLACES or not all(abs(angle) <= 6.2832 for angle in angles):
        raise ValueError(f"{key} = {text!r} has not three angles within +-2 pi rad; write 0,0,1.571")
    return rotation_of(angles)


class HandSection(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Settings of [[users]] for a hand and its tool (`tool_frame`)."""

    position_scale: Scale = 1.0
    force_scale: Scale = 1.0
    rotation: Rotation = ""
    clutch_button: Button = 0  # number of the button that is the clutch, from 1; 0: none
    workspace_limit_m: LimitText = "none"  # workspace limit as text, read by `limit_of`
    gravity_compensation: bool = False  # the device carries its own handle, where its record has a mass

    def tool_and_limit(self, axes: int) -> tuple[ToolFrame | None, WorkspaceLimit]:
        """Return the frame of the tool, None where it moves as the hand does, and the limit. Raises ValueError."""
        frame = ToolFrame(self.position_scale, self.force_scale, rotation_of(self.rotation), self.clutch_button)
        if not frame.keeps(axes):
            raise ValueError(
                f"rotation = {self.rotation!r} turns the axes of the room out of its {axes}; "
                "set object.axes = 3, or turn by half turns"
            )
        limit = limit_of(self.workspace_limit_m)
        if why := unfit(HandChange(workspace_limit_m=limit, gravity_compensation=self.gravity_compensation), axes):
            raise ValueError(why)
        return None if frame == ToolFrame() else frame, limit


_PARSERS: Mapping[str, Parser] = {
    "position_scale": _scale, "force_scale": _scale, "rotation": _rotation, "clutch": _switch,
    "workspace_limit_m": lambda _, text: limit_of(text), "gravity_compensation": _switch,
    "impedance_nspm": lambda key, text: number_of(key, text, LEAST_NSPM, MOST_NSPM, auto=True),
    "wave_filter_hz": filter_of,
    "prefer": lambda key, text: choice_of(key, text, get_args(types.Prefer)),
    "stiffness_npm": lambda key, text: number_of(key, text, 0.0, MOST_STIFFNESS_NPM),
    "damping_nspm": lambda key, text: number_of(key, text, 0.0, MOST_DAMPING_NSPM),
}  # fmt: skip
KEYS = tuple(_PARSERS)
LINE_KEYS = ("impedance_nspm", "wave_filter_hz", "prefer")
SPRING_KEYS = ("stiffness_npm", "damping_nspm")


def parsed(pairs: Sequence[str]) -> HandChange:
    """Return the change that `key=value` texts say. Raises ValueError, which names key, value, bound and cure."""
    return HandChange(**read_pairs(pairs, _PARSERS))


def unfit(change: HandChange, axes: int) -> str:
    """Return why a hand of `axes` axes cannot have this change, "" if it can."""
    limit = change.workspace_limit_m or NO_LIMIT
    places = min(axes, PLACES)
    if change.rotation is not None and not change.frame().keeps(axes):
        return f"the rotation turns the axes of the room out of its {axes}; turn by half turns, or set object.axes = 3"
    if limit.kind == "box" and len(limit.numbers_um) != 2 * places:
        return f"workspace_limit_m: the box has {len(limit.numbers_um)} numbers, and {places} axes need {2 * places}"
    if change.gravity_compensation and places < PLACES:
        return "gravity_compensation needs the vertical axis; set object.axes = 3"
    return ""
