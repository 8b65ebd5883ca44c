"""The messages of a recording, one struct for each kind of topic. Times are those of the message, never in it.

Inputs of a core are `Tick` (its sample and timing), `Datagram` on a topic `datagram_in`, `Input`, `Answer` and, at the
server, the number of frames in `Step`; everything else came out of a core. A topic is `/<end>/<kind>`, where the end is
a person's name, `server`, or `room/<name>`.
"""

import msgspec

from cogrip.protocol.drawing import Shape

Number = float | None  # a number; null where it is not finite, or there is none
Row = tuple[Number, ...]


class Record(msgspec.Struct, frozen=True, gc=False):
    """Base of all messages. Every key is in every message, so that a plot has no holes.

    A field that is added gets a default, so that older files can be read, and a line in `schema.DESCRIPTIONS`.
    """


class TickHead(Record, frozen=True, gc=False):
    """Part of a `Tick` that changes with every tick."""

    tick: int
    late_us: int  # how late this tick came
    work_us: int  # how long the work of the tick before took
    position_m: Row | None  # the sample as read; null: there was none, or it is in `unfit`
    velocity_mps: Row  # velocity that the device gives, else the estimated one
    force_n: Row  # F of P eq. 9, held until the next tick
    work_j: Number  # the hand's work against the force so far
    port_j: Number  # energy that went into the line so far


class Tick(TickHead, frozen=True, gc=False):
    """One tick of a client: its sample, the force that it answered, and its ledgers after it.

    What changes with every tick stands first, what changes with every frame behind it: so it compresses better, and the text
    of that is encoded once (`RecordedClient`).
    """

    wave_up: Row  # u sent at the last frame border [sqrt(W)]
    wave_down: Row  # v held over this frame [sqrt(W)]
    object_m: Row  # the object as last received
    margin_j: Number = None  # least reserve of the downlink so far; none without waves
    rtt_ms: Number = None
    lost: int = 0  # frames from the server that were lost, so far
    state: str = "live"  # state of the client's safety
    skipped: int = 0  # ticks that were skipped, so far
    playout_frames: float | None = None  # playout delay now; none without waves
    given_mps: Row | None = None  # the sample's own velocity where it is not `velocity_mps`
    unfit: tuple[tuple[str, ...], tuple[str, ...] | None] | None = None  # a sample with numbers that are not finite
    age_ticks: int = 0  # how old the sample was
    up_ms: Number = None  # one-way delays as last measured, as far as the clocks' offset is known
    down_ms: Number = None
    reserve_j: Number = None  # reserve of the downlink, as of this frame: `margin_j` is its least; none without waves
    buttons: int = 0  # buttons of the sample: bit k, button k + 1 is down
    orientation: Row | None = None  # orientation of the handle, quaternion w, x, y, z
    grip_m: Number = None  # opening of the gripper
    device_reserve_j: Number = None  # energy that the device port may still give


class Datagram(Record, frozen=True, gc=False):
    """A datagram as it was, and at the server whose: the address as its socket names it, as JSON text."""

    data: bytes
    address: str = ""


class Input(Record, frozen=True, gc=False):
    """An input of a core other than a tick, a step or a datagram: its kind, and the tagged struct as JSON text."""

    kind: str
    value: str = ""


class Answer(Record, frozen=True, gc=False):
    """Answer to a server core's query: a session number, a ticket's hash, an admission, a shown token, or a loop's ticks."""

    room: str = ""
    session: int = 0
    ticks: str = ""
    ticket: str = ""
    grant: str = ""  # the grant, or the denial, as JSON text
    shown: str = ""  # id of the token that was shown with a ticket, as JSON text


class Event(Record, frozen=True, gc=False):
    """Event of a core, as text."""

    text: str


class SeatStep(Record, frozen=True, gc=False):
    """One seat after a step; margins are the least so far, reserves those of now."""

    user: str
    seated: bool
    proxy_m: Row
    force_n: Row
    up_margin_j: Number
    line_margin_j: Number
    up_used_j: Number
    down_made_j: Number
    lost: int
    up_reserve_j: Number = None
    line_reserve_j: Number = None
    normal_n: Number = None  # contact forces at the seat's tool, and its slip; none without a scene
    friction_n: Number = None
    slip_m: Number = None
    buttons: int = 0  # buttons that are down after the edges of this step
    edges: tuple[int, ...] = ()  # edges that the world was given in this step: above 0 a button went down, below 0 up
    edge_ticks: tuple[int, ...] = ()  # age of each edge when it was sent, in ticks of the client
    orientation: Row | None = None  # orientation of the handle, as told last
    grip_m: Number = None


class Step(Record, frozen=True, gc=False):
    """One step of a room: its object and its seats, after it."""

    step: int
    object_m: Row
    object_mps: Row
    seats: tuple[SeatStep, ...]
    frames: int = 1  # network frames in this step: more than 1 where the loop missed steps
    late_us: int = 0
    work_us: int = 0
    skipped: int = 0


class Geoms(Record, frozen=True, gc=False):
    """Shapes that a room's scene is drawn of: before its first poses, and where an offset has changed."""

    shapes: tuple[Shape, ...]
    offsets_m: Row  # position of each seat's own frame less the object's, three numbers a seat
    left_out: tuple[str, ...] | msgspec.UnsetType = msgspec.UNSET  # what the scene has and the shapes do not say


class Poses(Record, frozen=True, gc=False):
    """Poses of a scene's bodies after a step, at most 64 a second: of each its place [m] and quaternion w, x, y, z."""

    step: int
    poses: Row


class Sensors(Record, frozen=True, gc=False):
    """Values of a scene's own sensors after a step, as often as poses. names: of each number, in the first record alone."""

    step: int
    names: tuple[str, ...]
    sensors: Row


class Clock(Record, frozen=True, gc=False):
    """A clock anchor: the recording machine's two clocks read together."""

    monotonic_ns: int
    utc_ns: int


class Gap(Record, frozen=True, gc=False):
    """Messages that are missing between the message before and this place."""

    messages: int
    reason: str


class Ledger(Record, frozen=True, gc=False):
    """Account of a client's core or a room's at its end, as JSON text."""

    account: str


KINDS: dict[str, type[Record]] = {
    "tick": Tick,
    "step": Step,
    "geoms": Geoms,
    "poses": Poses,
    "sensors": Sensors,
    "datagram_in": Datagram,
    "datagram_out": Datagram,
    "input": Input,
    "answer": Answer,
    "event": Event,
    "account": Ledger,
    "clock": Clock,
    "gap": Gap,
}
"""Record, by the last part of the topic."""


def kind_of(topic: str) -> str:
    """Return the last part of a topic."""
    return topic.rpartition("/")[2]
