"""Waves of one datagram, as a line takes them in. Compiled, `received_waves.pyx` takes its place."""

from cogrip.machine.rows import Floats
from cogrip.protocol.wire.messages import Waves


class ReceivedWaves:
    """The numbers of a `Waves` without a handle, under its names; `numbers` and `states` count those of waves and state.

    One object takes in any number of datagrams, one after the other.
    """

    __slots__ = (
        "acknowledged", "applied", "axes", "echo_ns", "edges", "first", "held_ns", "impedance_nspm", "made_j", "numbers",
        "phase", "port_j", "sent_ns", "session", "since", "squares", "state", "states", "total", "waves",
    )  # fmt: skip

    def decode(self, datagram: bytes) -> bool:
        """Take in a datagram; False, and nothing is to be read, where msgspec has to decode it: here always."""
        return False

    def read(self, message: Waves) -> None:
        """Take in a message that was decoded."""
        stamp = message.stamp
        self.session, self.sent_ns, self.echo_ns, self.held_ns = (
            message.session,
            stamp.sent_ns,
            stamp.echo_ns,
            stamp.held_ns,
        )
        self.state, self.states, self.applied = message.state, len(message.state), message.applied
        self.impedance_nspm, self.since, self.edges = message.impedance_nspm, message.since, message.edges
        metadata = (message.made_j, message.port_j, message.acknowledged)
        self.put(message.first, message.waves, message.total, message.squares, metadata, message.phase)

    def put(
        self, first: int, waves: Floats, total: Floats, squares: Floats, metadata: tuple[float, float, int], phase: int
    ) -> None:
        """Take in what concerns the line alone. Sums that differ in length from each other have no axes.

        metadata: made_j, port_j, acknowledged
        """
        self.first, self.waves, self.numbers, self.phase = first, waves, len(waves), phase
        self.total, self.squares, self.axes = total, squares, len(total) if len(total) == len(squares) else 0
        self.made_j, self.port_j, self.acknowledged = metadata

    def frame(self, place: int) -> tuple[float, ...]:
        """Return a frame, by its place in the datagram."""
        axes = self.axes
        return tuple(self.waves[place * axes : (place + 1) * axes])

    def total_row(self) -> tuple[float, ...]:
        """Return `total`."""
        return tuple(self.total)

    def squares_row(self) -> tuple[float, ...]:
        """Return `squares`."""
        return tuple(self.squares)

    def state_from(self, first: int, end: int) -> tuple[float, ...]:
        """Return a part of the state."""
        return tuple(self.state[first:end])
