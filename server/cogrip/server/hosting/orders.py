"""An administrator's orders as a worker gets them, and its measures as the front gets them."""

from collections import deque

from cogrip.server.administration.orders import AnyOrder, OrderReply, Request
from cogrip.server.hosting.link import Answered, NewSnapshot, ProcessLink
from cogrip.server.snapshot import Snapshot, encode


class LinkOrders:
    """Orders of the front, in place of `Control`."""

    def __init__(self, link: ProcessLink) -> None:
        self._link = link
        self._waiting: deque[Request] = deque()

    def add(self, number: int, order: AnyOrder) -> None:
        """Take in an order."""
        self._waiting.append(Request(order, number))

    def poll(self, now_ns: int | None = None) -> list[Request]:
        """Return new orders, each to be answered by `answer`."""
        found = list(self._waiting)
        self._waiting.clear()
        return found

    def answer(self, request: Request, reply: OrderReply) -> None:
        """Answer an order."""
        assert isinstance(request.caller, int)
        self._link.send(Answered(request.caller, reply))

    def close(self) -> None:
        """Do nothing: the link goes on."""


class LinkMeasures:
    """Snapshots for the front, in place of `MetricsFeed`. not_taken: those that found no room."""

    address = ""

    def __init__(self, link: ProcessLink) -> None:
        self._link = link
        self.not_taken = 0

    def put(self, snapshot: Snapshot) -> None:
        """Send a snapshot."""
        self.not_taken += not self._link.send(NewSnapshot(encode(snapshot)))

    def close(self) -> None:
        """Do nothing: the link goes on."""
