"""Administration of a front: orders go to the workers that they concern, and their answers become one."""

import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import msgspec

from cogrip.machine.addition import add_integers
from cogrip.server.administration.orders import (
    NO_CLUSTER,
    CloseRoomOrder,
    DrainOrder,
    KickOrder,
    MarkOrder,
    NewRoomOrder,
    OrderReply,
    ReloadOrder,
    Request,
    SetHandOrder,
    SetRoomOrder,
    StatusOrder,
    WhoOrder,
)
from cogrip.server.admission.roster import MOST_LISTED
from cogrip.server.events import ServerEvent
from cogrip.server.hosting.link import Answered, Obey
from cogrip.server.hosting.placement import HomeProcess
from cogrip.server.hosting.public_socket import PublicSocket
from cogrip.server.io.authenticator import READING, TokenAuthenticator
from cogrip.server.io.control import Control
from cogrip.server.io.metrics_feed import MetricsFeed
from cogrip.server.io.published_state import PublishedState
from cogrip.server.io.rooms_on_demand import all_open, drawn_name, none_opened, unfit_name, unknown_template
from cogrip.server.io.service_notify import ServiceNotifier
from cogrip.server.snapshot import Snapshot

EVERY_NS = 500_000_000
ANSWER_NS = 4_000_000_000  # longest time that workers may take to answer: less than the one who asks waits


@dataclass(slots=True)
class _WaitingOrder:
    request: Request
    asked: list[HomeProcess]
    until_ns: int
    answers: list[OrderReply] = field(default_factory=list)


class Administration:
    """Orders, tokens and metrics of a front. `begin` before it runs, `end` after; each part may be missing.

    published, more_degraded  as of `Housekeeping`
    """

    def __init__(
        self, front: PublicSocket, say: Callable[[ServerEvent], None], software: str, *, control: Control | None,
        authenticator: TokenAuthenticator | None, metrics: MetricsFeed | None, reload: Callable[[], bool],
        drain: Callable[[str], tuple[str, bool]] = lambda host: (NO_CLUSTER, False),
    ) -> None:  # fmt: skip
        """reload: says whether the tokens are to be read again, by a signal. drain: lets the rooms of a host move."""
        self.published: PublishedState | None = None
        self.more_degraded: Callable[[], Mapping[str, str]] = dict
        self._drain = drain
        self._front, self._say, self._software = front, say, software
        self._control, self._authenticator, self._metrics = control, authenticator, metrics
        self._asks_reload = reload
        self._notifier = ServiceNotifier()
        self._waiting: dict[int, _WaitingOrder] = {}
        self._number = 0
        self._next_ns = self._watchdog_ns = 0
        self._start_ns = time.monotonic_ns()
        front.answered = self._take_answer
        if control is not None:
            self._say = front.say = control.publishing(say)
            control.metrics_at = metrics.address if metrics is not None else ""
        if authenticator is not None:
            front.revoke, front.revoke_room = authenticator.revoke, authenticator.revoke_room

    def begin(self) -> None:
        """Notify that all is ready, and work between the front's datagrams."""
        if self.published is not None:
            self.published.begin()
        self._end_void()
        self._front.chores.append(self.chore)
        self._notifier.ready(f"rooms: {len(self._front.rooms)}")

    def chore(self, now_ns: int) -> None:
        """Do what is due."""
        if self._authenticator is not None:
            self._authenticator.read_on()
        if self._asks_reload():
            self._notifier.reloading(now_ns)
            self._reload()
            self._notifier.ready()
        if self._control is not None:
            for request in self._control.poll(now_ns):
                self._obey(request, now_ns)
        for number, each in list(self._waiting.items()):
            each.asked = [worker for worker in each.asked if worker.state == "ready"]
            if not each.asked or now_ns >= each.until_ns:
                del self._waiting[number]
                self._answer(each)
        if now_ns >= self._next_ns:
            self._next_ns = now_ns + EVERY_NS
            self._end_void()
            if self.published is not None:
                self.published.chore(now_ns)
            if self._metrics is not None:
                self._metrics.put(self._snapshot(now_ns))
        every_ns = self._notifier.watchdog_every_ns
        if every_ns is not None and now_ns >= self._watchdog_ns:
            self._watchdog_ns = now_ns + every_ns
            self._notifier.watchdog()

    def end(self) -> None:
        """End with the front."""
        self._notifier.stopping()
        for part in (self._control, self.published, self._authenticator, self._metrics):
            if part is not None:
                part.close()
        self._notifier.close()

    def _end_void(self) -> None:
        """Tell the workers of tokens that became void."""
        if self._authenticator is None:
            return
        expired, revoked = self._authenticator.expired(), self._authenticator.revoked()
        if expired or revoked:
            self._front.homes.void(revoked, expired)

    def _reload(self) -> tuple[str, bool]:
        if self._authenticator is None:
            text = "nothing to read again: this server takes no tokens"
            self._say(ServerEvent("reloaded", text))
            return text, True
        good = self._authenticator.reload()
        self._end_void()
        if good is None:
            return READING, True
        return ("tokens were read again" if good else "tokens could not be read; see the log"), good

    def _obey(self, request: Request, now_ns: int) -> None:
        """Hand an order over to the workers that it concerns."""
        assert self._control is not None
        order = request.order
        if isinstance(order, ReloadOrder):
            text, ok = self._reload()
            if not (ok and self._authenticator and self._front.homes.rereads):
                self._control.answer(request, OrderReply(ok, text))
                return  # else each room has to read them, and to end who came in by them
        if isinstance(order, DrainOrder):
            text, ok = self._drain(order.host)
            self._control.answer(request, OrderReply(ok, text))
            return
        if isinstance(order, NewRoomOrder):
            self._open_room(request, order, now_ns)
            return
        if isinstance(order, CloseRoomOrder) and order.room not in self._front.opened:
            self._control.answer(request, OrderReply(False, none_opened(order.room, self._front.opened)))
            return
        room = "" if isinstance(order, StatusOrder | ReloadOrder) else order.room
        names_here = sorted([*self._front.rooms, *self._front.opened])
        if isinstance(order, SetRoomOrder) and not room and len(names_here) > 1:
            names = ", ".join(names_here)
            self._control.answer(request, OrderReply(False, f"there are several rooms; name one by --room: {names}"))
            return
        if isinstance(order, SetHandOrder) and not room:
            seats = sorted(self._front.rooms_of(order.user))
            if len(seats) > 1:
                text = f"{order.user!r} is seated in several rooms; name one by --room"
                self._control.answer(request, OrderReply(False, text))
                return
            room = seats[0] if seats else ""
        ready = [worker for worker in self._front.homes.workers if worker.state == "ready"]
        home = self._front.homes.home(room) if room else None
        self._ask(request, [home] if home is not None else ready, now_ns)

    def _ask(self, request: Request, asked: list[HomeProcess], now_ns: int) -> None:
        """Hand an order over to these processes, and wait for their answers."""
        self._number += 1
        self._waiting[self._number] = _WaitingOrder(request, asked, now_ns + ANSWER_NS)
        for worker in list(asked):
            worker.link.send(Obey(self._number, request.order))

    def _open_room(self, request: Request, order: NewRoomOrder, now_ns: int) -> None:
        """Let the process with the most rooms of a template left open one, or say why not."""
        assert self._control is not None
        front, homes, name = self._front, self._front.homes, order.name or drawn_name(order.template)
        opening = [each for each in self._waiting.values() if isinstance(each.request.order, NewRoomOrder)]
        spare = {room for names in homes.templates.values() for room in names}
        taken = {*front.rooms, *front.opened, *spare, *(_opened_by(each) for each in opening)}
        left = dict(homes.spare(order.template))
        for each in opening:
            for home in each.asked:
                left[home] = left.get(home, 0) - 1  # also where it is of another template: it does for a moment
        most = max(left, key=lambda each: left[each], default=None)
        why = unknown_template(order.template, homes.templates) or unfit_name(name)
        if not why and name in taken:
            why = f"there is a room {name!r} already; give another name"
        if why or most is None or left[most] <= 0:
            starting = any(each.state == "assigned" for each in homes.workers)
            none = "a process is starting anew; try again" if starting else all_open(order.template)
            self._control.answer(request, OrderReply(False, why or none))
            return
        self._ask(request._replace(order=msgspec.structs.replace(order, name=name)), [most], now_ns)

    def _take_answer(self, given: Answered) -> None:
        each = self._waiting.get(given.number)
        if each is None:
            return
        each.answers.append(given.answer)
        if len(each.answers) >= len(each.asked):
            del self._waiting[given.number]
            self._answer(each)

    def _answer(self, each: _WaitingOrder) -> None:
        assert self._control is not None
        front = self._front
        answer = merged(each.request.order, each.answers, len(front.rooms) + len(front.opened))
        if isinstance(each.request.order, StatusOrder):
            spare = {
                name: add_integers(count for _, count in front.homes.spare(name)) for name in front.homes.templates
            }
            text = "; ".join([answer.text, *(f"{count} spare of {name}" for name, count in spare.items())])
            answer = msgspec.structs.replace(answer, text=text, degraded=self._degraded())
        self._control.answer(each.request, answer)

    def _snapshot(self, now_ns: int) -> Snapshot:
        """Return one of all workers: their rooms side by side, their counts summed."""
        unknown = self._front.homes.unknown
        known = () if unknown else self._front.homes.workers  # an old snapshot would say that no room ticks
        parts = [worker.snapshot for worker in known if worker.snapshot is not None]
        dropped = Counter(self._front.drops())
        for part in parts:
            dropped.update(part.dropped)
        replaced = self._front.homes.replaced
        failed = Counter({"worker replaced": replaced} if replaced else {})
        degraded = self._degraded()
        for part in parts:
            failed.update(part.failed)
            degraded |= part.degraded
        rooms = sorted((room for part in parts for room in part.rooms), key=lambda room: room.room)
        uptime_s = (now_ns - self._start_ns) * 1e-9
        received = self._front.received + add_integers(part.received or 0 for part in parts)
        sent = self._front.sent + add_integers(part.sent or 0 for part in parts)
        return Snapshot(self._software, uptime_s, tuple(rooms), dict(dropped), received, sent, dict(failed), degraded)

    def _degraded(self) -> dict[str, str]:
        """Return what the front cannot write or know now, and why."""
        degraded = {
            "tokens": self._authenticator.not_written if self._authenticator is not None else "",
            "directory": self._front.homes.unknown,
            "orders": self._control.trouble if self._control is not None else "",
            **({self.published.name: self.published.trouble} if self.published is not None else {}),
            **self.more_degraded(),
        }
        return {name: why for name, why in degraded.items() if why}


def _opened_by(waiting: _WaitingOrder) -> str:
    order = waiting.request.order
    return order.name if isinstance(order, NewRoomOrder) else ""


def merged(order: object, answers: Sequence[OrderReply], rooms: int) -> OrderReply:
    """Return one answer of several workers; rooms: of all."""
    if not answers:
        return OrderReply(False, "no worker has answered; try again")
    if len(answers) == 1:
        return answers[0]
    good = [answer for answer in answers if answer.ok]
    match order:
        case StatusOrder() if good:
            found = sorted((room for each in good for room in each.rooms), key=lambda room: room.name)[:MOST_LISTED]
            gone = {name: why for each in good for name, why in each.degraded.items()}
            words = f"{rooms} rooms in {len(good)} of {len(answers)} processes that were asked"
            return OrderReply(len(good) == len(answers), words, rooms=tuple(found), degraded=gone)
        case WhoOrder() if good:
            people = tuple(
                sorted((who for each in good for who in each.people), key=lambda who: (who.room, who.seat is None))
            )
            more = len(people) - MOST_LISTED
            words = f"{len(people)} in {rooms} rooms" if people else "nobody is here"
            silent = {answer.text for answer in answers if not answer.ok}
            words = "; ".join([words, *sorted(silent)])
            return OrderReply(True, f"{words}; {more} are not listed" if more > 0 else words, people[:MOST_LISTED])
        case ReloadOrder() if len(good) == len(answers):
            return OrderReply(True, f"tokens were read again in {len(good)} rooms")
        case MarkOrder() if good:
            return OrderReply(True, f"marked in {rooms} rooms: {order.text}")
        case KickOrder() | SetHandOrder() | SetRoomOrder() if good:
            return OrderReply(True, "; ".join(dict.fromkeys(answer.text for answer in good)))
    return OrderReply(bool(good), "; ".join(dict.fromkeys(answer.text for answer in good or answers)))
