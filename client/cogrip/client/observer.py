"""One who looks on, without I/O: the session, and the newest view of the object and of the hands that hold it."""

from collections import deque

from cogrip.protocol.histogram import DurationHistogram
from cogrip.protocol.messages import View
from cogrip.protocol.session import ClientSession


class ObserverCore:
    """`view` is the newest one, None before the first; `age_ns` says how old it is."""

    def __init__(self, session: ClientSession) -> None:
        """session: a new one, or one whose welcome said that its client may only look on."""
        self.session = session
        self.rtt = DurationHistogram()
        self.view: View | None = None
        self.views = 0
        self._seen_ns = 0
        self._session_id = 0

    @property
    def outbox(self) -> deque[bytes]:
        """Messages to send, oldest first."""
        return self.session.outbox

    def call(self, now_ns: int) -> None:
        self.session.connect(now_ns)

    def receive(self, datagram: bytes, now_ns: int) -> None:
        message = self.session.receive(datagram, now_ns)
        if not isinstance(message, View):
            return
        rtt_ns = self.session.clock.read(message.stamp, now_ns)
        if rtt_ns is not None:
            self.rtt.add(rtt_ns)
        if not _whole(message):
            self.session.drop("unfit")
        elif self.view is not None and message.session == self._session_id and message.number <= self.view.number:
            self.session.drop("late view")
        else:
            self.view, self._session_id, self._seen_ns = message, message.session, now_ns
            self.views += 1

    def poll(self, now_ns: int) -> None:
        """Session timers, and the word that we are still there; call at least every 100 ms."""
        self.session.poll(now_ns)
        self.session.heartbeat(now_ns)

    def leave(self, reason: str, now_ns: int) -> None:
        self.session.leave(reason, None, now_ns)

    def age_ns(self, now_ns: int) -> int | None:
        """Since the newest view came, None before the first."""
        return None if self.view is None else now_ns - self._seen_ns


def _whole(view: View) -> bool:
    """Whether hands and forces are those of the seats it names."""
    axes, odd = divmod(len(view.object), 2)
    return not odd and len(view.proxies_m) == len(view.forces_n) == axes * len(view.seats)
