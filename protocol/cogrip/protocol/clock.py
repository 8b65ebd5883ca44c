"""What two clocks that know nothing of each other tell by stamps: the round trip, the other clock's offset, the way there
and the way back (`SPEC.md` section 8, docs/decisions/0012-measured-delay.md).

A stamp that comes back gives the four times of NTP (RFC 5905): ours when it went (T1), theirs when it came and when the answer
went (T2, T3), ours now (T4). With theta what the other clock shows beyond ours, no datagram comes before it went:

    there = T2 - T1 - theta >= 0        back = T4 - T3 + theta >= 0        so  T3 - T4 <= theta <= T2 - T1

Each datagram gives both bounds. The tightest of all, kept apart for each way, enclose theta; its estimate is their middle.
That is wrong by half of what the least way there is longer than the least way back, exactly, which no stamp can show; it is
never wrong by more than half their sum. Clocks drift: a bound gives way by DRIFT_PPM for as long as nothing better comes, so
an old one is worth what it can still prove. All times are integers [ns].
"""

from cogrip.protocol.messages import Stamp

DRIFT_PPM = 500  # of one clock against the other, at most: crystals are within 100, the most that NTP corrects is 500
_DRIFT_PART = 1_000_000 // DRIFT_PPM
MOST_RTT_NS = 60_000_000_000


class Clock:
    """Stamps outgoing messages and reads incoming ones. What does not fit is no reading, and counted in `wild`.

    there_ns, back_ns   one way, of our newest message that was heard and of theirs that came last; None before an echo came
                        back. A way begins where a message is made and ends where the other loop takes it in
    fresh               whether the stamp read last told a new `there_ns`: an echo that is repeated tells it once
    """

    __slots__ = (
        "_echoed_ns", "_heard_at_ns", "_heard_sent_ns", "_high_ns", "_low_ns", "_read_ns", "back_ns", "fresh", "there_ns",
        "turned", "wild",
    )  # fmt: skip

    def __init__(self) -> None:
        self._heard_sent_ns = 0
        self._heard_at_ns = 0
        self._echoed_ns = 0  # the newest of our own readings that came back
        self._low_ns = self._high_ns = 0  # the bounds of theta
        self._read_ns: int | None = None  # when they were right
        self.there_ns: int | None = None
        self.back_ns: int | None = None
        self.fresh = False
        self.turned = 0  # times that the bounds contradicted each other: a clock was set, or somebody lies
        self.wild = 0

    def stamp(self, now_ns: int) -> Stamp:
        held = now_ns - self._heard_at_ns if self._heard_sent_ns else 0
        return Stamp(now_ns, self._heard_sent_ns, held)

    def read(self, stamp: Stamp, now_ns: int) -> int | None:
        """Round-trip time [ns], None before an echo of our own came back."""
        self.fresh = False
        sent_ns, echo_ns = stamp.sent_ns, stamp.echo_ns
        if sent_ns > self._heard_sent_ns:
            self._heard_sent_ns, self._heard_at_ns = sent_ns, now_ns
        if not echo_ns:
            return None
        rtt_ns = now_ns - echo_ns - stamp.held_ns
        if not 0 <= rtt_ns < MOST_RTT_NS:
            self.wild += 1
            return None
        low_ns = sent_ns - now_ns  # T3 - T4
        high_ns = low_ns + rtt_ns  # T2 - T1, as T2 = T3 - held
        before_ns = self._read_ns
        least_ns, most_ns = low_ns, high_ns
        if before_ns is not None:
            way_ns = (now_ns - before_ns) // _DRIFT_PART + 1  # rounded up
            kept_ns = self._low_ns - way_ns
            if kept_ns > least_ns:
                least_ns = kept_ns
            kept_ns = self._high_ns + way_ns
            if kept_ns < most_ns:
                most_ns = kept_ns
            if least_ns > most_ns:  # what was kept contradicts what is said now
                self.turned += 1
                least_ns, most_ns = low_ns, high_ns
        self._low_ns, self._high_ns, self._read_ns = least_ns, most_ns, now_ns
        offset_ns = (least_ns + most_ns) >> 1
        self.back_ns = offset_ns - low_ns
        if echo_ns > self._echoed_ns:
            self._echoed_ns = echo_ns
            self.fresh = True
            self.there_ns = high_ns - offset_ns
        return rtt_ns

    @property
    def offset_ns(self) -> int | None:
        """What the other end's clock shows beyond ours, None while nothing is known."""
        return None if self._read_ns is None else (self._low_ns + self._high_ns) >> 1

    @property
    def uncertainty_ns(self) -> int | None:
        """`offset_ns` is right to this if no clock drifts by more than DRIFT_PPM: half of the least ways there and back."""
        return None if self._read_ns is None else (self._high_ns - self._low_ns + 1) >> 1
