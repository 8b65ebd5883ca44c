"""Messages of the Inverse service's simulation channel: JSON, one state update for each message that it is sent. Pure.

Sources: Haply's pages "WebSocket Protocol", "Simulation Channel", "Control Commands" and "Basis Permutation"
(docs.haply.co/inverseSDK/service, 3.1.1 and 3.5), and Isaac Lab's `se3_haply.py`. Format 3.0, on port 10000, is another one.

Axes of the service: x right, y forward, z up; ours: x toward the user, y right, z up. So a vector (x, y, z) of the service is
(-y, x, z) here, a quarter turn about z, which turns the vector part of an orientation the same way.
"""

from collections import Counter
from collections.abc import Sequence
from math import hypot
from typing import Annotated, Literal, TypeAlias

import msgspec
from msgspec import Meta

from cogrip.devices.arm.exchange import Reading
from cogrip.devices.device import DeviceError
from cogrip.machine.addition import add_integers

FARTHEST_M = 2.0  # largest coordinate of a cursor: no arm is so long
UNIT = 0.01  # largest difference of an orientation's norm from 1
BUTTONS = ("a", "b", "c")  # buttons of a wireless VerseGrip; the one on a wire has a single one

Dialect: TypeAlias = Literal["auto", "vector", "values"]
"""Name of the force in a command: "vector" on the pages of 3.5, "values" on those of 3.1 and in Isaac Lab."""

_Metres = Annotated[float, Meta(ge=-FARTHEST_M, le=FARTHEST_M)]
_Part = Annotated[float, Meta(ge=-1.0 - UNIT, le=1.0 + UNIT)]


class _Place(msgspec.Struct, frozen=True):
    x: _Metres
    y: _Metres
    z: _Metres


class _Orientation(msgspec.Struct, frozen=True):
    w: _Part
    x: _Part
    y: _Part
    z: _Part


class _Vector(msgspec.Struct, frozen=True):
    x: float = 1.0
    y: float = 1.0
    z: float = 1.0


class _Velocity(msgspec.Struct, frozen=True):
    x: float = 0.0
    y: float = 0.0
    z: float = 0.0


class _Scaled(msgspec.Struct, frozen=True):
    scale: _Vector = _Vector()


class _Basis(msgspec.Struct, frozen=True):
    permutation: str = "XYZ"


class _ArmState(msgspec.Struct, frozen=True):
    cursor_position: _Place
    cursor_velocity: _Velocity = _Velocity()
    transform: _Scaled = _Scaled()


class _ArmStatus(msgspec.Struct, frozen=True):
    power_supply: bool = True
    ready: bool = True
    calibrated: bool = True


class _ArmConfig(msgspec.Struct, frozen=True):
    basis: _Basis = _Basis()
    mount: _Scaled = _Scaled()


class _Arm(msgspec.Struct, frozen=True):
    device_id: str
    state: _ArmState
    status: _ArmStatus = _ArmStatus()
    config: _ArmConfig = _ArmConfig()


class _GripState(msgspec.Struct, frozen=True):
    """buttons: of a wireless grip; button: of one on a wire."""

    orientation: _Orientation | None = None
    buttons: dict[str, bool] = {}
    button: bool = False


class _Grip(msgspec.Struct, frozen=True):
    device_id: str
    state: _GripState = _GripState()


class _Update(msgspec.Struct, frozen=True):
    """Initial inventory, or state update; what else they hold is left unread."""

    inverse3: list[_Arm] = []
    wireless_verse_grip: list[_Grip] = []
    verse_grip: list[_Grip] = []
    session_id: int | None = None

    @property
    def grips(self) -> list[_Grip]:
        return [*self.wireless_verse_grip, *self.verse_grip]


_decode = msgspec.json.Decoder(_Update).decode
GRIP_FIELDS = 5  # A reading ends with w, x, y, z (0 where not known) and the buttons.


class InverseCodec:
    """A `Codec` of whole messages. Readings hold a position [m] and a speed [m/s], then GRIP_FIELDS.

    device_id, grip_id: chosen ones, "" until `choose` has; refused: messages that were none, by why
    """

    def __init__(self, device_id: str, grip_id: str, dialect: Dialect) -> None:
        self._asked = device_id, grip_id, dialect
        self.refused: Counter[str] = Counter()
        self.device_id = self.grip_id = ""
        self._head = self._tail = ""
        self._uncalibrated = False

    def choose(self, message: bytes, where: str, *, uncalibrated: bool) -> None:
        """Take the device and the grip from the service's inventory. Raises DeviceError where force must not flow.

        uncalibrated: a device that is not calibrated will do.
        """
        device_id, grip_id, dialect = self._asked
        try:
            update = _decode(message)
        except (msgspec.MsgspecError, UnicodeDecodeError) as error:
            raise DeviceError(
                f"{where}: its first message is no inventory of the formats 3.1 to 3.5 ({error}); is this the Inverse"
                " service, and its port that of the simulation channel, 10001?"
            ) from None
        arms = {arm.device_id: arm for arm in update.inverse3}
        arm = arms.get(device_id) if device_id else next(iter(arms.values()), None)
        if arm is None or (len(arms) > 1 and not device_id):
            there = ", ".join(arms) or "none"
            what = f"no Inverse3 {device_id!r}" if device_id else "no Inverse3" if not arms else "several Inverse3"
            raise DeviceError(f"{where}: the service has {what}, of {there}; plug one in, or choose by device=ID")
        self._refuse(arm, where, uncalibrated=uncalibrated)
        self._uncalibrated = uncalibrated
        grips = [grip.device_id for grip in update.grips]
        if grip_id and grip_id not in grips:
            raise DeviceError(f"{where}: the service has no VerseGrip {grip_id!r}, of {', '.join(grips) or 'none'}")
        self.device_id, self.grip_id = arm.device_id, grip_id or next(iter(grips), "")
        if dialect == "auto":
            dialect = "values" if update.session_id is None else "vector"  # 3.1 shows no session in its inventory
        name = msgspec.json.encode(self.device_id).decode()
        self._head = f'{{"inverse3":[{{"device_id":{name},"commands":{{"set_cursor_force":{{"{dialect}":'
        self._tail = "}}}]}"

    @staticmethod
    def _refuse(arm: _Arm, where: str, *, uncalibrated: bool) -> None:
        status, config = arm.status, arm.config
        scales = {config.mount.scale, arm.state.transform.scale}
        for wrong, cure in (
            ("has no power", "plug in its supply") if not status.power_supply else ("", ""),
            ("is not ready", "see Haply Hub") if not status.ready else ("", ""),
            ("is not calibrated", "calibrate it in Haply Hub, or add uncalibrated=allow where its positions are right")
            if not (status.calibrated or uncalibrated) else ("", ""),
            (f"has axes {config.basis.permutation}", "set its basis to XYZ in Haply Hub")
            if config.basis.permutation not in ("XYZ", "+X+Y+Z") else ("", ""),
            ("has positions that are scaled", "set the scale of its mount and transform to 1 in Haply Hub")
            if scales != {_Vector()} else ("", ""),
        ):  # fmt: skip
            if wrong:
                raise DeviceError(f"{where}: the Inverse3 {arm.device_id} {wrong}; {cure}, then open it again")

    def encode(self, commands: Sequence[float]) -> bytes:
        """The message that pushes the hand with this force [N], in our axes. It is applied once."""
        x, y, z = commands
        return f'{self._head}{{"x":{y:.6f},"y":{-x:.6f},"z":{z:.6f}}}{self._tail}'.encode()

    def load(self, counts: Sequence[float]) -> bytes | None:
        """See `Codec.load`: there are no counters."""
        return None

    def reset(self) -> None:
        """See `Codec.reset`: messages are whole."""

    @property
    def skipped(self) -> int:
        """Count of messages that were no state update."""
        return self.refused.total()

    def feed(self, data: bytes) -> list[Reading]:
        """Return the reading of one message, in our axes; one that is none is counted."""
        if not data:
            return []
        try:
            update = _decode(data)
        except (msgspec.MsgspecError, UnicodeDecodeError) as error:
            bounds = isinstance(error, msgspec.ValidationError) and "Expected `float`" in str(error)
            self.refused["message out of range" if bounds else "message malformed"] += 1
            return []
        arm = next((arm for arm in update.inverse3 if arm.device_id == self.device_id), None)
        if arm is None:
            return [Reading((), "the service has it no more", rejected=True)]
        at, rate = arm.state.cursor_position, arm.state.cursor_velocity
        speed = hypot(rate.x, rate.y, rate.z)
        status, why = arm.status, ""
        if not (status.power_supply and status.ready and (status.calibrated or self._uncalibrated)):
            why = (
                "no power"
                if not status.power_supply
                else "not ready"
                if not status.ready
                else "not calibrated any more"
            )
        return [Reading((-at.y, at.x, at.z, speed, *self._grip(update)), why, rejected=bool(why))]

    def _grip(self, update: _Update) -> tuple[float, ...]:
        state = next((grip.state for grip in update.grips if grip.device_id == self.grip_id), None)
        if state is None:
            return (0.0,) * GRIP_FIELDS
        pressed = add_integers(state.buttons.get(name, False) << bit for bit, name in enumerate(BUTTONS)) or int(
            state.button
        )
        q = state.orientation
        if q is None:
            return (0.0, 0.0, 0.0, 0.0, pressed)
        norm = hypot(q.w, q.x, q.y, q.z)
        if abs(norm - 1.0) > UNIT:
            self.refused["orientation that is none"] += 1
            return (0.0, 0.0, 0.0, 0.0, pressed)
        return (q.w / norm, -q.y / norm, q.x / norm, q.z / norm, pressed)
