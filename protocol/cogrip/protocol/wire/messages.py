"""Messages: MessagePack arrays, coded and checked by msgspec (`SPEC.md` section 3).

Every decoded number is finite and bounded, every list and text has a bounded length; anything else raises MalformedError and
nothing but it. Only the accounts of the last two messages hold free numbers: an unstable session may report inf or nan, and
no force is computed from them.
"""

from collections.abc import Mapping, Sequence
from struct import Struct
from typing import Annotated, Literal

import msgspec

from cogrip.protocol.axes import PLACES, POSE_AXES
from cogrip.protocol.drawing import (
    MOST_SHAPES,
    MOST_SURFACE_BYTES,
    RGB_BYTES,
    TILE,
    Shape,
    ShapeKind,
    Solid,
    Two,
    check_colours,
    check_points,
    check_triangles,
)
from cogrip.protocol.settings.effects import MOST_EFFECTS, Effect, EffectTank
from cogrip.protocol.settings.hand import HandChange
from cogrip.protocol.settings.seat import SeatSettings
from cogrip.protocol.settings.tool_frame import Scale
from cogrip.protocol.settings.types import MOST_PARTNERS, MOST_WAVES, SeatNumber
from cogrip.protocol.texts import MARK_BYTES as MARK_BYTES
from cogrip.protocol.texts import TEXT_BYTES
from cogrip.protocol.wire.accounts import ClientAccount, RoomAccount, SeatAccount
from cogrip.protocol.wire.handle import Buttons, EdgeCount, Handle, Opening, Quaternion, is_unit

MOST_NOTES = 8  # most sentences about a room's world that observers are told
MOST_WAIT_MS = 600_000  # longest wait for a server that restarts
PROTOCOL_VERSION = 1
MAGIC: Literal["cogrip"] = "cogrip"
MAX_DATAGRAM_BYTES = 1232  # longest datagram: it fits one IPv6 packet on every path (RFC 8200: 1280 less the headers)
DTLS_BYTES = 37  # bytes that DTLS adds to a message: record header 13, AES-GCM nonce 8 and tag 16
MAX_MESSAGE_BYTES = MAX_DATAGRAM_BYTES - DTLS_BYTES
HELLO_BYTES = 1024  # length to which a hello is padded: no answer to an unauthenticated peer is longer than its request
SHORT = 40  # most characters of a ShortText
DEVICE_BYTES = 200  # longest device address: senders cut it to so many bytes of UTF-8
LEAVE_TEXT_BYTES = 150  # longest text of a leave, which has an account behind it

Counter = Annotated[int, msgspec.Meta(ge=0, le=2**53)]
Ticks = Annotated[int, msgspec.Meta(ge=-(2**31), le=2**31)]
Session = Annotated[int, msgspec.Meta(ge=1, le=2**63 - 1)]
Ns = Annotated[int, msgspec.Meta(ge=0, le=2**63 - 1)]
WaveValue = Annotated[float, msgspec.Meta(ge=-1e4, le=1e4)]  # wave [sqrt(W)]
Total = Annotated[float, msgspec.Meta(ge=-1e15, le=1e15)]
Metres = Annotated[float, msgspec.Meta(ge=-1e3, le=1e3)]
MetresPerSecond = Annotated[float, msgspec.Meta(ge=-1e4, le=1e4)]
Newtons = Annotated[float, msgspec.Meta(ge=-1e9, le=1e9)]
Entered = Annotated[float, msgspec.Meta(ge=0.0, le=1e15)]  # energy that entered a channel [J]
MOST_STATE = 2 * POSE_AXES + 2 * PLACES
"""Most numbers of a state: with the angle travelled and the proxy of local contact."""
VIEWED_SEATS = 16  # most seats of a view, which has room for no more; further ones are left out
Axes = msgspec.Meta(min_length=1, max_length=POSE_AXES)
Text = Annotated[str, msgspec.Meta(max_length=TEXT_BYTES)]
ShortText = Annotated[str, msgspec.Meta(max_length=SHORT)]
Secret = Annotated[str, msgspec.Meta(max_length=32, pattern=r"^[A-Za-z0-9_-]*\Z")]
"""Secret as text: 128 bits in base64url take 22 letters."""
MOST_TOKEN = 640
"""Most characters of a token that somebody has signed: beside names, a device's address and a ticket it fits one hello."""
Token = Annotated[str, msgspec.Meta(max_length=MOST_TOKEN, pattern=r"^[A-Za-z0-9_.-]*\Z")]
"""Right to join as text: a secret, or a signed token, whose three parts have dots between them."""
Digest = Secret  # digest, in the letters of a secret, so that the longest welcome is no longer than a hello
Role = Literal["player", "observer"]
NO_BOUND = 1e6  # value on the wire that stands for a record's bound that is infinite
Bound = Annotated[float, msgspec.Meta(ge=0.0, le=NO_BOUND)]
Milliseconds = Annotated[float, msgspec.Meta(ge=-1e6, le=1e6)]
Frames = Annotated[int, msgspec.Meta(ge=0, le=2**53)]
Presence = Literal["joining", "live", "silent"]
ServerPlace = Annotated[str, msgspec.Meta(max_length=60)]
MOST_FRONTS = 8  # most fronts that a redirect names
MOST_POSES = 39  # most poses of one message
_POSE = Struct("<H7f")
MOST_POSE_BYTES = MOST_POSES * _POSE.size
BodyNumber = Annotated[int, msgspec.Meta(ge=0, le=MOST_SHAPES - 1)]
Sizes = Annotated[tuple[Annotated[float, msgspec.Meta(ge=0.0, le=1e3)], ...], msgspec.Meta(min_length=3, max_length=3)]
Place = Annotated[tuple[Metres, ...], msgspec.Meta(min_length=3, max_length=3)]
Rgba = Annotated[tuple[Annotated[float, msgspec.Meta(ge=0.0, le=1.0)], ...], msgspec.Meta(min_length=4, max_length=4)]
Pose = tuple[float, ...]  # place [m], quaternion w, x, y, z


class MalformedError(ValueError):
    """The datagram is not a message of this protocol."""


class Message(msgspec.Struct, frozen=True, array_like=True, gc=False, forbid_unknown_fields=True):
    """Base of all messages: an array whose first element is the tag."""


class Stamp(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Clock readings for the round trip: rtt = now - echo_ns - held_ns at the end that gets its own echo back."""

    sent_ns: Ns  # time at the sender's clock when this was sent
    echo_ns: Ns = 0  # newest sent_ns received from the other end, 0 when none
    held_ns: Ns = 0  # time since that one was received


class Hello(Message, frozen=True, tag=1):
    """A client's request for a seat. Tag to nonce have this place and meaning, and the whole this length, in every version."""

    magic: Literal["cogrip"]
    version: Counter
    software: ShortText
    nonce: Ns
    room: ShortText  # name of the room; "" any
    name: ShortText  # name of the seat; "" any that is free
    digest: ShortText  # digest of the expected settings; "" accept the server's
    device: Annotated[str, msgspec.Meta(max_length=DEVICE_BYTES)]  # address of the device
    device_axes: Annotated[int, msgspec.Meta(ge=1, le=6)]
    device_rate_hz: Annotated[float, msgspec.Meta(ge=1.0, le=1e6)]
    device_force_n: Bound  # the record's peak force
    device_speed_mps: Bound  # the record's over-speed limit
    role: Role = "player"
    token: Token = ""  # right to join; "" none
    ticket: Secret = ""  # right to resume a seat session, from its welcome; "" none
    device_torque_nm: Bound = 0.0  # the record's peak torque; 0 of a device that does not turn
    device_speed_radps: Bound = 0.0
    padding: Annotated[bytes, msgspec.Meta(max_length=HELLO_BYTES)] = b""


class Welcome(Message, frozen=True, tag=2):
    """A server's grant of a seat."""

    version: Counter
    nonce: Ns
    session: Session
    digest: Digest
    software: ShortText
    # settings of the seat; an observer's are those of the room's first seat, with the observer's own name
    settings: SeatSettings
    ticket: Secret = ""
    role: Role = "player"


class Refuse(Message, frozen=True, tag=3):
    """A server's refusal of a hello. Its layout is the same in every protocol version."""

    version: Counter
    nonce: Ns
    code: ShortText
    reason: Text


class Waves(Message, frozen=True, tag=4):
    """The newest frames of one direction with the running totals before the oldest of them (theory section 3.5)."""

    session: Session
    first: Counter  # number of the oldest frame in `waves`
    # frame by frame, axis by axis
    waves: Annotated[tuple[WaveValue, ...], msgspec.Meta(min_length=1, max_length=MOST_WAVES)]
    total: Annotated[tuple[Total, ...], Axes]  # sum of all waves before `first`, per axis [sqrt(W)]
    squares: Annotated[tuple[Total, ...], Axes]  # sum of their squares, per axis [W]
    made_j: Total  # energy of this direction's waves where they are made, up to the newest frame
    port_j: Total  # energy that went into the line at the sender's port, up to the newest frame
    acknowledged: Counter  # frame of the other direction that was applied last, plus 1; 0: none yet
    stamp: Stamp
    # client: hand's position before frame 0, then after the newest frame [m], of a pose also the angle travelled between
    # [rad]; server: object's position [m], velocity [m/s]; axes 4 to 6 are a rotation vector [rad], its rates [rad/s]
    state: Annotated[tuple[MetresPerSecond, ...], msgspec.Meta(min_length=2, max_length=MOST_STATE)]
    # client: device ticks by which the newest frame ended later than frames of M ticks would have; server: ticks by which the
    # client may send later, below 0 should send sooner
    phase: Ticks = 0
    applied: Counter = 0  # client: ticks for which frame `acknowledged` - 1 had been applied as the newest frame ended
    # impedance with which the newest frame was made
    impedance_nspm: Annotated[float, msgspec.Meta(ge=0.0, le=1e4)] = 0.0
    since: Counter = 0  # number of the first frame with that impedance; both 0: the settings' one
    handle: Handle | None = None  # up: state of the handle, where the device has one
    edges: EdgeCount = 0  # down: edges of buttons that the object's world has been given in this seat session


class State(Message, frozen=True, tag=5):
    """Virtual coupling (theory section 5): the sender's position and velocity."""

    session: Session
    number: Counter
    position_m: Annotated[tuple[Metres, ...], Axes]
    velocity_mps: Annotated[tuple[MetresPerSecond, ...], Axes]
    port_j: Total
    acknowledged: Counter
    stamp: Stamp
    handle: Handle | None = None  # handle and edges as in `Waves`
    edges: EdgeCount = 0


class Heartbeat(Message, frozen=True, tag=6):
    """Keeps a seat while there are no waves to send."""

    session: Session
    stamp: Stamp


class Leave(Message, frozen=True, tag=7):
    """A client's end of its session, with its account."""

    session: Session
    reason: Text
    account: ClientAccount | None = None


class Farewell(Message, frozen=True, tag=8):
    """A server's end of a session, with its accounts of seat and room."""

    session: Session
    reason: Text
    seat: SeatAccount | None = None
    room: RoomAccount | None = None


class View(Message, frozen=True, tag=9):
    """State for an observer: the object, and the hands of those who hold it, each in its own frame."""

    session: Session
    number: Counter  # number of the room's step
    # position [m], velocity [m/s]
    object: Annotated[tuple[MetresPerSecond, ...], msgspec.Meta(min_length=2, max_length=6)]
    seats: Annotated[tuple[SeatNumber, ...], msgspec.Meta(max_length=VIEWED_SEATS)]  # seats that hold the object
    proxies_m: Annotated[tuple[Metres, ...], msgspec.Meta(max_length=3 * VIEWED_SEATS)]  # seat by seat, axis by axis
    forces_n: Annotated[tuple[Newtons, ...], msgspec.Meta(max_length=3 * VIEWED_SEATS)]
    stamp: Stamp


class Power(Message, frozen=True, tag=10):
    """Time-domain passivity (`SPEC.md` section 7b): power variables at the sender's port, and the energy that went in there."""

    session: Session
    number: Counter
    # The client tells the position of its proxy, the mean velocity over the frame, and the force on the hand at the last
    # tick; the server tells position and velocity of the object, and the force for the hand.
    position_m: Annotated[tuple[Metres, ...], Axes]
    velocity_mps: Annotated[tuple[MetresPerSecond, ...], Axes]
    force_n: Annotated[tuple[Newtons, ...], Axes]
    entered_j: Annotated[tuple[Entered, ...], Axes]  # energy that entered the channel here: inward flow alone
    taken_j: Annotated[tuple[Entered, ...], Axes]  # energy that left the channel here: outward flow alone
    port_j: Total  # energy in less energy out here, of all axes
    acknowledged: Counter  # number of the other direction's message popped last, plus 1; 0: none yet
    stamp: Stamp
    handle: Handle | None = None  # handle and edges as in `Waves`
    edges: EdgeCount = 0

    def of_axes(self, axes: int) -> bool:
        """Return whether every list has one number an axis."""
        motion = len(self.position_m) == len(self.velocity_mps) == axes
        return motion and len(self.force_n) == len(self.entered_j) == len(self.taken_j) == axes


class Person(Message, frozen=True, tag=11):
    """One seated person for an observer: place, delays and energy margins as the server knows them; None: not known."""

    session: Session
    number: Counter  # number of the room's step
    seat: SeatNumber
    name: ShortText
    state: Presence  # joining: not on the object yet; silent: nothing came for QUIET_NS
    # place of the hand after the newest frame, in the hand's own frame
    hand_m: Annotated[tuple[Metres, ...], msgspec.Meta(max_length=3)]
    # position of the hand's own frame less the object's
    offset_m: Annotated[tuple[Metres, ...], msgspec.Meta(max_length=3)]
    rtt_ms: Milliseconds | None
    up_ms: Milliseconds | None  # one-way delays, without jitter buffers
    down_ms: Milliseconds | None
    buffer_frames: Annotated[float, msgspec.Meta(ge=0.0, le=2.0**53)] | None  # depth of the jitter buffer up
    behind_frames: Frames | None  # frames sent down and not yet applied when the newest applied frame was sent up
    lost: Counter  # frames up that were lost, so far
    sent: Counter
    up_margin_j: Total | None  # least energy margin of the uplink, so far
    line_margin_j: Total | None
    up_reserve_j: Total | None  # energy reserve of the uplink, now
    line_reserve_j: Total | None
    buttons: Buttons = 0  # bit k: button k + 1 is down
    edges: EdgeCount = 0  # edges of the buttons, so far: a press between two messages shows here
    orientation: Quaternion | None = None  # orientation of the handle, as told last
    grip_m: Opening | None = None
    position_scale: Scale = 1.0
    force_scale: Scale = 1.0
    clutched: bool = False

    def __post_init__(self) -> None:
        if self.orientation is not None and not is_unit(self.orientation):
            raise ValueError("the orientation is no unit quaternion")


class Bodies(Message, frozen=True, tag=12):
    """Poses of some of a scene's bodies for an observer: records of body, place [m], quaternion w, x, y, z (`_POSE`)."""

    session: Session
    number: Counter  # number of the room's step
    poses: Annotated[bytes, msgspec.Meta(min_length=_POSE.size, max_length=MOST_POSE_BYTES)]

    def __post_init__(self) -> None:
        if len(self.poses) % _POSE.size:
            raise ValueError(f"{len(self.poses)} bytes are no whole poses")
        for body, pose in self.read():
            if body >= MOST_SHAPES or not all(abs(each) <= 1e3 for each in pose) or not is_unit(pose[3:]):
                raise ValueError(f"the pose of body {body} is out of bounds")

    def read(self) -> list[tuple[int, Pose]]:
        """Return body and pose of each record."""
        return [(body, tuple(pose)) for body, *pose in _POSE.iter_unpack(self.poses)]


class Geom(Message, frozen=True, tag=13):
    """One of the shapes that a scene is drawn of, for an observer (`drawing.Shape`), or that a player's client renders."""

    session: Session
    count: Annotated[int, msgspec.Meta(ge=1, le=MOST_SHAPES)]  # number of shapes of the scene
    number: BodyNumber  # number of this shape, from 0
    kind: ShapeKind
    size_m: Sizes
    body: BodyNumber | None
    place_m: Place
    orientation: Quaternion
    rgba: Rgba | None
    seat: SeatNumber | None
    object: bool
    triangles: Annotated[bytes, msgspec.Meta(max_length=MOST_SURFACE_BYTES)] = b""
    colours: Annotated[bytes, msgspec.Meta(max_length=RGB_BYTES * TILE * TILE)] = b""
    points: Annotated[bytes, msgspec.Meta(max_length=MOST_SURFACE_BYTES)] = b""
    period_m: Two | None = None
    solid: Solid | None = None

    def __post_init__(self) -> None:
        if not is_unit(self.orientation):
            raise ValueError("the orientation is no unit quaternion")
        check_triangles(self.kind, self.triangles)
        check_colours(self.kind, self.triangles, self.colours, self.period_m)
        check_points(self.kind, self.points)
        if self.solid is not None and (self.triangles or self.colours or self.points):
            raise ValueError("a shape of a copy has a surface")

    @classmethod
    def of(cls, shapes: Sequence[Shape], number: int, session: int) -> "Geom":
        """Return the message of one of these shapes."""
        told = shapes[number]
        return cls(
            session, len(shapes), number, told.kind, told.size_m, told.body, told.place_m, told.orientation, told.rgba,
            told.seat, told.object, told.triangles or b"", told.colours or b"", told.points or b"", told.period_m or None,
            told.solid or None,
        )  # fmt: skip

    @property
    def shape(self) -> Shape:
        """The shape itself."""
        return Shape(
            self.kind, self.size_m, self.body, self.place_m, self.orientation, self.rgba, self.seat, self.object,
            self.triangles or msgspec.UNSET, self.colours or msgspec.UNSET, self.points or msgspec.UNSET,
            self.period_m or msgspec.UNSET, self.solid or msgspec.UNSET,
        )  # fmt: skip


class Mark(Message, frozen=True, tag=14):
    """A marker. A client that sets one repeats it until the server tells it with `theirs`; the server tells everybody."""

    session: Session
    number: Counter  # number of the marker, from 1; up: the client counts, down: the room
    text: Annotated[str, msgspec.Meta(max_length=MARK_BYTES)]
    step: Counter = 0  # down: step of the room at which the marker was set
    seat: SeatNumber | None = None  # down: seat that set the marker; None: the administrator, or the world
    theirs: Counter = 0  # down: number that the marker had on its way up


class SetHand(Message, frozen=True, tag=15):
    """Down, a change of a player's hand settings, repeated until it is acknowledged; up, a report of all, likewise."""

    session: Session
    number: Counter  # number of the sender's changes or reports in this session, from 1; down 0: it acknowledges alone
    acknowledged: Counter  # newest number of the other end that was taken; 0: none
    hand: HandChange = HandChange()


class Effects(Message, frozen=True, tag=16):
    """Haptic effects that a player's client is to render: which there are, and one of them. The client answers which it has."""

    session: Session
    version: Counter  # version of the effects that are told: it grows with every change
    # numbers of effects; down: those in force; up: those of them that are known
    numbers: Annotated[tuple[Counter, ...], msgspec.Meta(max_length=MOST_EFFECTS)]
    tank_mj: EffectTank
    number: Counter = 0  # number of `effect`
    effect: Effect | None = None  # down: an effect, in the hand's own frame; None: none is left


class Edges(Message, frozen=True, tag=17):
    """Edges of buttons of a player's device, sent as they happen: frames' messages repeat them until they are acknowledged."""

    session: Session
    stamp: Stamp
    handle: Handle


class Redirect(Message, frozen=True, tag=18):
    """A server's answer to a hello whose room another one serves: where it is, and who knows where it is later."""

    version: Counter
    nonce: Ns
    place: ServerPlace  # place of the server as HOST:PORT, the host an address
    fronts: Annotated[tuple[ServerPlace, ...], msgspec.Meta(max_length=MOST_FRONTS)] = ()


class Restart(Message, frozen=True, tag=19):
    """A server's word that it restarts: whoever holds on comes back by the ticket, and waits so long for it."""

    session: Session
    wait_ms: Annotated[int, msgspec.Meta(ge=0, le=MOST_WAIT_MS)]


class Note(Message, frozen=True, tag=20):
    """A sentence for an observer about the room's world: what is not drawn of it, or was changed of it."""

    session: Session
    count: Annotated[int, msgspec.Meta(ge=1, le=MOST_NOTES)]  # number of sentences of the room
    number: Annotated[int, msgspec.Meta(ge=0, le=MOST_NOTES - 1)]  # number of this one, from 0
    text: Annotated[str, msgspec.Meta(max_length=TEXT_BYTES)]


class Intent(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Intention of one hand as its client estimates it (theory 5b), in the frame of whoever gets it."""

    seat: SeatNumber
    made_ns: Ns  # when it was estimated, by the server's clock as its client knows it; 0: not known
    intention_m: Annotated[tuple[Metres, ...], Axes]
    rate_mps: Annotated[tuple[MetresPerSecond, ...], Axes]
    stiffness_npm: Annotated[float, msgspec.Meta(ge=0.0, le=1e4)]  # stiffness of the hand; 0 while it lets go
    donated_j: Entered  # energy that it has given to all others so far

    def of_axes(self, axes: int) -> bool:
        """Return whether every list has one number an axis."""
        return len(self.intention_m) == len(self.rate_mps) == axes


class Partner(Message, frozen=True, tag=21):
    """A partner's model (`SPEC.md` section 7e): the client tells its hand and its intention, the server object and partners."""

    session: Session
    number: Counter
    position_m: Annotated[tuple[Metres, ...], Axes]
    velocity_mps: Annotated[tuple[MetresPerSecond, ...], Axes]
    intents: Annotated[tuple[Intent, ...], msgspec.Meta(max_length=MOST_PARTNERS)]
    acknowledged: Counter
    stamp: Stamp
    handle: Handle | None = None  # handle and edges as in `Waves`
    edges: EdgeCount = 0
    port_j: Total = 0.0  # up: what the hand put in and was given, less what it took and gave away

    def of_axes(self, axes: int, object_axes: int = 0) -> bool:
        """Return whether every list has one number an axis; object_axes: of the object, where that has more."""
        own = len(self.position_m) == len(self.velocity_mps) == (object_axes or axes)
        return own and all(intent.of_axes(axes) for intent in self.intents)


def pack_poses(poses: Sequence[tuple[int, Sequence[float]]]) -> bytes:
    """Return the records of a `Bodies`."""
    return b"".join([_POSE.pack(body, *pose) for body, pose in poses])


Latest = State | Power | Partner  # frames of which the newest wins
Frame = Waves | Latest  # message that a coupling sends once a frame
FRAMES: Mapping[str, type[Frame]] = {
    each.__name__: each for each in (Waves, State, Power, Partner)
}  # types by `CouplingKind.frame`
Observed = Person | Bodies | Geom | Mark | Effects | Note  # message to an observer beside views
AnyMessage = (
    Hello
    | Welcome
    | Refuse
    | Frame
    | Edges
    | Heartbeat
    | Leave
    | Farewell
    | View
    | Observed
    | SetHand
    | Redirect
    | Restart
)
_decoder = msgspec.msgpack.Decoder(AnyMessage)
encode = msgspec.msgpack.Encoder().encode


def decode(datagram: bytes) -> AnyMessage:
    """Return the message in a datagram. Raises MalformedError, and nothing else, for anything that is not one."""
    if len(datagram) > MAX_MESSAGE_BYTES:
        raise MalformedError(f"{len(datagram)} bytes, more than {MAX_MESSAGE_BYTES}")
    try:
        message: AnyMessage = _decoder.decode(datagram)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise MalformedError(str(error)) from None
    return message


def padded(hello: Hello) -> bytes:
    """Return a hello at its full length: HELLO_BYTES, more with a long token. The padding is always a bin 16: so every length
    is possible.
    """
    bare = encode(msgspec.structs.replace(hello, padding=b""))[:-2]
    length = max(0, HELLO_BYTES - len(bare) - 3)
    return bare + b"\xc5" + length.to_bytes(2, "big") + bytes(length)
