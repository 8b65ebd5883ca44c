"""Faults between a firmware and its driver, as verbs. Virtual time; garbage is seeded.

silence     replies are not sent                              garbage      noise in place of replies
split       a reply comes in two parts, a millisecond apart   merge        a reply waits, and comes with the next
short       a reply is cut off                                slow         replies come 30 ms late
stale       an old reply stands before the next               model        the device says that it is another one
jump        encoder a slips by 400 counts                     stuck        encoder b gives no pulses
unplug      the port is gone, and so is the power             deaf         requests are not received, so nothing is answered
reversed    motor a is wired the wrong way round
"""

from itertools import takewhile
from random import Random

VERBS = (
    "silence", "garbage", "split", "merge", "short", "slow", "stale", "model", "jump", "stuck", "unplug", "deaf", "reversed",
)  # fmt: skip
SPLIT_NS = 1_000_000
SLOW_NS = 30_000_000


class Faults:
    """The faults in force, applied to replies. reports: replies are whole reports, never merged or split."""

    def __init__(self, seed: int = 1, *, reports: bool = False) -> None:
        self._reports = reports
        self._random = Random(seed)
        self._until_ns: dict[str, float] = {}
        self._queue: list[tuple[int, bytes]] = []
        self._waiting = b""
        self._last = b""

    def start(self, verb: str, until_ns: float = float("inf")) -> None:
        """Start a fault that lasts until `until_ns`. Raises ValueError for an unknown verb."""
        if verb not in VERBS:
            raise ValueError(f"no fault {verb!r}; there are: {', '.join(VERBS)}")
        self._until_ns[verb] = until_ns

    def stop(self, verb: str) -> None:
        self._until_ns.pop(verb, None)

    @property
    def running(self) -> tuple[str, ...]:
        return tuple(self._until_ns)

    def on(self, verb: str, now_ns: int) -> bool:
        """Return True while the fault lasts."""
        until_ns = self._until_ns.get(verb)
        if until_ns is None:
            return False
        if now_ns >= until_ns:
            del self._until_ns[verb]
            return False
        return True

    def send(self, reply: bytes, now_ns: int) -> None:
        """A reply leaves the firmware: at once, later, in parts, or never."""
        if self._until_ns or self._waiting:
            self._send_badly(reply, now_ns)
        else:
            self._queue.append((now_ns, reply))
        self._last = reply

    def _send_badly(self, reply: bytes, now_ns: int) -> None:
        on = self.on
        at_ns = now_ns + (SLOW_NS if on("slow", now_ns) else 0)
        if on("silence", now_ns):
            return
        if on("garbage", now_ns):
            reply = self._random.randbytes(len(reply))
        if on("short", now_ns):
            reply = reply[: self._random.randrange(1, len(reply))]
        if on("stale", now_ns) and self._last:
            self._queue.append((at_ns, self._last))
            self.stop("stale")
        if on("merge", now_ns) and not self._waiting:
            self._waiting = reply
            return
        parts = [self._waiting, reply] if self._waiting else [reply]
        self._waiting = b""
        if not self._reports:
            parts = [b"".join(parts)]
            if on("split", now_ns) and len(parts[0]) > 1:
                cut = self._random.randrange(1, len(parts[0]))
                parts = [parts[0][:cut], parts[0][cut:]]
        self._queue += [(at_ns + number * SPLIT_NS * on("split", now_ns), part) for number, part in enumerate(parts)]

    def due(self, now_ns: int) -> list[bytes]:
        """Return the replies that have come through by now, in order."""
        out = list(takewhile(lambda sent: sent[0] <= now_ns, self._queue))
        del self._queue[: len(out)]
        return [data for _, data in out]

    @property
    def waiting(self) -> bool:
        """True while a reply is still in flight."""
        return bool(self._queue)

    def clear(self) -> None:
        """Everything on its way is lost: the device was unplugged."""
        self._queue.clear()
        self._waiting = b""
