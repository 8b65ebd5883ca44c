"""What `cogrip join --observe` shows: the object, and the hands of those who hold it, as they move."""

from collections.abc import Callable, Sequence

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.live import Live
from rich.table import Table

from cogrip.cli.terminal.problem import Problem
from cogrip.client.io.paths import JoinError, Paths
from cogrip.client.observer import ObserverCore
from cogrip.client.observer_loop import LiveObserver
from cogrip.protocol.io.stop import Stop
from cogrip.protocol.session import ClientSession

TABLE_EVERY_NS = 100_000_000
LINE_EVERY_NS = 1_000_000_000


def look_on(session: ClientSession, calls: Paths, stop: Stop, seconds: float | None, console: Console) -> int:
    """Show the room until it ends, at a terminal as a table, elsewhere as a line a second. Exit code 0 if all went well.

    Raises Problem where no place is to be had.
    """
    core = ObserverCore(session)

    def say(text: str) -> None:
        console.print(text, markup=False)

    try:
        if console.is_terminal:
            with Live(table(core, 0), console=console, auto_refresh=False) as live:
                drawn = Every(TABLE_EVERY_NS, lambda now_ns: live.update(table(core, now_ns), refresh=True))
                failed = LiveObserver(core, calls, stop, say, drawn.show, seconds).run()
        else:
            told = Every(LINE_EVERY_NS, lambda now_ns: say(line(core, now_ns)))
            failed = LiveObserver(core, calls, stop, say, told.show, seconds).run()
    except JoinError as error:
        raise Problem(str(error)) from None
    back = {"came back": session.resumed, "seat taken anew": session.renewed}
    counts = {**session.dropped, **calls.counted(), **back}
    say(f"{_name(core)}: saw {core.views} views")
    dealt = ", ".join(f"{name} {count}" for name, count in sorted(counts.items()) if count)
    if dealt:
        say(f"{_name(core)}: dealt with: {dealt}")
    if failed:
        say(f"{_name(core)}: the looking on broke off: {failed}")
    elif session.ended:
        say(f"{_name(core)}: the looking on is over: {session.ended}")
    return 1 if failed or session.ended else 0


class Every:
    """Calls `draw` at most once in `every_ns`."""

    def __init__(self, every_ns: int, draw: Callable[[int], None]) -> None:
        self._every_ns = every_ns
        self._draw = draw
        self._next_ns = 0

    def show(self, core: ObserverCore, now_ns: int) -> None:
        if now_ns >= self._next_ns:
            self._next_ns = now_ns + self._every_ns
            self._draw(now_ns)


def table(core: ObserverCore, now_ns: int) -> Table:
    """One row a hand."""
    shown = Table(title=_object(core, now_ns), title_justify="left", box=SIMPLE_HEAD)
    for heading in ("seat", "hand\nmm", "force\nN"):
        shown.add_column(heading, justify="right")
    for seat, hand, force in _hands(core):
        shown.add_row(f"{seat + 1}", _vector(hand, 1e3, "+6.1f"), _vector(force, 1.0, "+5.2f"))
    return shown


def line(core: ObserverCore, now_ns: int) -> str:
    """The same in one line."""
    hands = "; ".join(
        f"seat {seat + 1} at {_vector(hand, 1e3, '+.1f')} mm, {_vector(force, 1.0, '+.2f')} N"
        for seat, hand, force in _hands(core)
    )
    return f"{_object(core, now_ns)}; {hands or 'nobody holds it'}"


def _object(core: ObserverCore, now_ns: int) -> str:
    view, age_ns = core.view, core.age_ns(now_ns)
    if view is None or age_ns is None:
        return "nothing seen yet"
    axes = len(view.object) // 2
    place, speed = _vector(view.object[:axes], 1e3, "+.1f"), _vector(view.object[axes:], 1e3, "+.1f")
    return f"object at {place} mm, {speed} mm/s, {age_ns / 1e6:.0f} ms ago"


def _hands(core: ObserverCore) -> list[tuple[int, Sequence[float], Sequence[float]]]:
    """Seat (from 0; people count from 1), place [m] and force [N] of everyone who holds the object."""
    view = core.view
    if view is None:
        return []
    axes = len(view.object) // 2
    spans = [slice(axes * each, axes * (each + 1)) for each in range(len(view.seats))]
    return [
        (seat, view.proxies_m[span], view.forces_n[span]) for seat, span in zip(view.seats, spans, strict=True)
    ]  # fmt: skip


def _name(core: ObserverCore) -> str:
    welcome = core.session.welcome
    return welcome.settings.user if welcome else "observer"


def _vector(values: Sequence[float], scale: float, form: str) -> str:
    return " ".join(format(value * scale, form) for value in values)
