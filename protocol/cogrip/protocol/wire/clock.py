"""Round trip, clock offset and one-way delays from stamps (`SPEC.md` section 8, docs/decisions/0012-measured-delay.md).

A stamp that comes back gives the four times of NTP (RFC 5905): ours at sending (T1), theirs at receiving and answering (T2,
T3), ours now (T4). With theta the other clock less ours, no datagram arrives before it was sent:

    forward = T2 - T1 - theta >= 0        return = T4 - T3 + theta >= 0        so  T3 - T4 <= theta <= T2 - T1

Each datagram gives both bounds. The tightest bound of each direction is kept; the estimate of theta is their middle. It is
wrong by half the difference of the two least one-way delays, exactly, which no stamp can show, and never by more than half
their sum. Clocks drift: a bound gives way by DRIFT_PPM until a better one comes. All times are integers [ns].
"""

from cogrip.protocol.wire.messages import Stamp

DRIFT_PPM = 500  # largest drift of one clock against the other: crystals are within 100, NTP corrects up to 500
_DRIFT_PART = 1_000_000 // DRIFT_PPM
MOST_RTT_NS = 60_000_000_000


class Clock:
    """Stamps outgoing messages and reads incoming ones.

    forward_ns, return_ns  one-way delay of our newest message that was echoed, and of the last message received; None before an
                           echo. A delay begins where a message is made and ends where the other loop takes it in
    fresh                  the stamp read last gave a new `forward_ns`: a repeated echo gives none
    contradictions         times that the bounds contradicted each other: a clock was set, or somebody lies
    implausible            stamps without a possible round trip, which are ignored
    """

    __slots__ = (
        "_any", "_echoed_ns", "_high_ns", "_low_ns", "_peer_sent_ns", "_read_ns", "_received_ns", "contradictions",
        "forward_ns", "fresh", "implausible", "return_ns",
    )  # fmt: skip

    def __init__(self) -> None:
        self._peer_sent_ns = 0  # the largest `sent_ns` received, and when
        self._received_ns = 0
        self._echoed_ns = 0  # the newest of our own readings that came back
        self._low_ns = self._high_ns = 0  # the bounds of theta
        self._any = False  # one was read
        self._read_ns = 0  # when they were read
        self.forward_ns: int | None = None
        self.return_ns: int | None = None
        self.fresh = False
        self.contradictions = self.implausible = 0

    def stamp(self, now_ns: int) -> Stamp:
        """Return the stamp of a message that is sent now."""
        return Stamp(now_ns, self._peer_sent_ns, self.held_ns(now_ns))

    def held_ns(self, now_ns: int) -> int:
        """Return the time since the other end's newest reading was received; 0 where none was."""
        return now_ns - self._received_ns if self._peer_sent_ns else 0

    def read(self, stamp: Stamp, now_ns: int) -> int | None:
        """Return the round-trip time of a received stamp [ns], None where it echoes nothing or is implausible."""
        return self.read_times(stamp.sent_ns, stamp.echo_ns, stamp.held_ns, now_ns)

    def read_times(self, sent_ns: int, echo_ns: int, held_ns: int, now_ns: int) -> int | None:
        """Do what `read` does with the readings of a stamp."""
        self.fresh = False
        if sent_ns > self._peer_sent_ns:
            self._peer_sent_ns, self._received_ns = sent_ns, now_ns
        if not echo_ns:
            return None
        rtt_ns = now_ns - echo_ns
        if rtt_ns < held_ns or rtt_ns - held_ns >= MOST_RTT_NS:  # in an order in which 64 bits are enough
            self.implausible += 1
            return None
        rtt_ns -= held_ns
        low_ns = sent_ns - now_ns  # T3 - T4
        high_ns = low_ns + rtt_ns  # T2 - T1, as T2 = T3 - held
        least_ns, most_ns = low_ns, high_ns
        if self._any:
            way_ns = (now_ns - self._read_ns) // _DRIFT_PART + 1  # rounded up
            kept_ns = self._low_ns - way_ns  # compared by hand: calls of min and max cost half as much again
            if kept_ns > least_ns:
                least_ns = kept_ns
            if self._high_ns < most_ns - way_ns:  # in this order, too: the other clock may be anything
                most_ns = self._high_ns + way_ns
            if least_ns > most_ns:  # the kept bounds contradict the new ones
                self.contradictions += 1
                least_ns, most_ns = low_ns, high_ns
        self._low_ns, self._high_ns, self._read_ns, self._any = least_ns, most_ns, now_ns, True
        offset_ns = least_ns + ((most_ns - least_ns) >> 1)
        self.return_ns = offset_ns - low_ns
        if echo_ns > self._echoed_ns:
            self._echoed_ns = echo_ns
            self.fresh = True
            self.forward_ns = high_ns - offset_ns
        return rtt_ns

    @property
    def offset_ns(self) -> int | None:
        """The other end's clock less ours, None while nothing is known."""
        return self._low_ns + ((self._high_ns - self._low_ns) >> 1) if self._any else None

    @property
    def uncertainty_ns(self) -> int | None:
        """Bound of the error of `offset_ns` if no clock drifts by more than DRIFT_PPM: half the least round trip."""
        return (self._high_ns - self._low_ns + 1) >> 1 if self._any else None
