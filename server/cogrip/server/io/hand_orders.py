"""Orders that change somebody's hand settings: answered once the client has reported what holds then."""

from collections.abc import Callable
from typing import NamedTuple

from cogrip.server import inputs
from cogrip.server.administration.orders import Request, SetHandOrder
from cogrip.server.core import ServerCore
from cogrip.server.seats.participants import Seat

ANSWER_NS = 3_000_000_000  # longest time that a client may take to answer: less than the one who asks waits

REASONS = " (its client has no such thing, or its device no handle mass, or a button holds the clutch)"

Say = Callable[[Request, str, bool], None]


class _Waiting(NamedTuple):
    """Order that its client has to answer. number: of its change."""

    request: Request
    order: SetHandOrder
    seat: Seat
    session: int
    number: int
    until_ns: int


class AwaitedOrders:
    """Those that wait for a client. say: answers an order."""

    def __init__(self, core: ServerCore, say: Say) -> None:
        self._core = core
        self._say = say
        self._waiting: list[_Waiting] = []

    def obey(self, request: Request, order: SetHandOrder, now_ns: int) -> None:
        """Tell the change, or answer why not."""
        named = [
            who for room, who in self._core.roster()
            if isinstance(who, Seat) and who.name == order.user and order.room in ("", room.called)
        ]  # fmt: skip
        if len(named) != 1:
            here = ", ".join(who.name for _, who in self._core.roster() if isinstance(who, Seat))
            text = f"{order.user!r} is seated in several rooms; name one by --room" if named else (
                f"nobody seated here is {order.user!r}; there is: {here or 'nobody'}"
            )  # fmt: skip
            self._say(request, text, False)
            return
        (seat,) = named
        if why := seat.settings.unfit_change(order.change):
            self._say(request, f"{seat.name}: {why}", False)
        elif not self._core.handle(inputs.SetHand(order.user, order.change, order.room), now_ns):
            self._say(request, f"{seat.name} has not answered the changes before; try again once they are there", False)
        else:
            self._waiting.append(_Waiting(request, order, seat, seat.session, seat.hand.number, now_ns + ANSWER_NS))

    def poll(self, now_ns: int) -> None:
        """Answer the orders whose client has answered, or has had its time."""
        for each in self._waiting.copy():
            gone = each.seat.session != each.session or each.seat.state != "seated"
            if gone or each.seat.hand.taken >= each.number or now_ns >= each.until_ns:
                self._waiting.remove(each)
                self._answer(each, gone)

    def _answer(self, each: "_Waiting", gone: bool) -> None:
        name, hand = each.seat.name, each.seat.hand
        if gone:
            self._say(each.request, f"{name} has left; join again, then set it", False)
        elif hand.taken < each.number:
            text = f"{name} has not answered for {ANSWER_NS * 1e-9:g} s; it holds once they do, see `cogrip who`"
            self._say(each.request, text, False)
        elif refused := [name for name in each.order.change.refused(hand.holds) if name not in self._later(each)]:
            kept = hand.holds.text
            self._say(each.request, f"{name} did not take {', '.join(refused)}{REASONS}; what holds: {kept}", False)
        else:
            self._say(each.request, f"{name}: {hand.holds.text}", True)

    def _later(self, each: "_Waiting") -> set[str]:
        """Return what later orders for the same seat change: what they set may hold by now."""
        return {name for order in self._waiting if order.seat is each.seat for name in order.order.change.given}
