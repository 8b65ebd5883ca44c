"""Display of `cogrip join --observe`: the object, and the hands of those who hold it."""

from collections.abc import Callable, Mapping, Sequence

from rich.console import Console
from rich.live import Live
from rich.table import Table

from cogrip.cli.terminal.problem import Problem
from cogrip.cli.terminal.tables import plain_table
from cogrip.client.io.paths import JoinError, Paths
from cogrip.client.observer import ObserverCore
from cogrip.client.observer_loop import LiveObserver
from cogrip.machine.stop import Stop
from cogrip.protocol.wire.session import ClientSession

TABLE_EVERY_NS = 100_000_000
LINE_EVERY_NS = 1_000_000_000


def observe_room(session: ClientSession, paths: Paths, stop: Stop, seconds: float | None, console: Console) -> int:
    """Show the room until it ends, at a terminal as a table, elsewhere as a line a second. Return 0 if all went well.

    Raises Problem where there is no observer slot.
    """
    core, say = ObserverCore(session), console.print
    with Problem.of(JoinError):
        if console.is_terminal:
            with Live(table(core, 0), console=console, auto_refresh=False) as live:
                drawn = Every(TABLE_EVERY_NS, lambda now_ns: live.update(table(core, now_ns), refresh=True))
                failed = LiveObserver(core, paths, stop, say, drawn.show, seconds).run()
        else:
            printed = Every(LINE_EVERY_NS, lambda now_ns: say(line(core, now_ns)))
            failed = LiveObserver(core, paths, stop, say, printed.show, seconds).run()
    name = session.welcome.settings.user if session.welcome else "observer"
    say(f"{name}: saw {core.views} views")
    resumptions = {"came back": session.resumed, "seat taken anew": session.renewed}
    if counts := counted({**session.dropped, **paths.counted(), **resumptions}):
        say(f"{name}: dealt with: {counts}")
    if failed:
        say(f"{name}: observing broke off: {failed}")
    elif session.ended:
        say(f"{name}: observing is over: {session.ended}")
    return 1 if failed or session.ended else 0


def counted(counts: Mapping[str, int]) -> str:
    """Return the counts that are not 0, by name."""
    return ", ".join(f"{name} {count}" for name, count in sorted(counts.items()) if count)


class Every:
    """Limit of how often `draw` is called: at most once in `every_ns`."""

    def __init__(self, every_ns: int, draw: Callable[[int], None]) -> None:
        self._every_ns = every_ns
        self._draw = draw
        self._next_ns = 0

    def show(self, core: ObserverCore, now_ns: int) -> None:
        if now_ns >= self._next_ns:
            self._next_ns = now_ns + self._every_ns
            self._draw(now_ns)


def table(core: ObserverCore, now_ns: int) -> Table:
    """Return a row a hand; seats are numbered as `cogrip who` numbers them."""
    hands = [(f"{seat}", _vector(at, 1e3, "+z6.1f"), _vector(force, 1.0, "+z5.2f")) for seat, at, force in _hands(core)]
    shown = plain_table(("seat", "hand\nmm", "force\nN"), hands, left=0)
    shown.title, shown.title_justify = _object(core, now_ns), "left"
    return shown


def line(core: ObserverCore, now_ns: int) -> str:
    """Return the same in one line."""
    hands = "; ".join(
        f"seat {seat} at {_vector(hand, 1e3, '+z.1f')} mm, {_vector(force, 1.0, '+z.2f')} N"
        for seat, hand, force in _hands(core)
    )
    return _object(core, now_ns) if core.view is None else f"{_object(core, now_ns)}; {hands or 'nobody holds it'}"


def _object(core: ObserverCore, now_ns: int) -> str:
    view, age_ns = core.view, core.age_ns(now_ns)
    if view is None or age_ns is None:
        return "no view yet"
    axes = len(view.object) // 2
    place, speed = _vector(view.object[:axes], 1e3, "+z.1f"), _vector(view.object[axes:], 1e3, "+z.1f")
    return f"object at {place} mm, {speed} mm/s, {age_ns / 1e6:.0f} ms ago"


def _hands(core: ObserverCore) -> list[tuple[int, Sequence[float], Sequence[float]]]:
    """Return seat (from 0), position [m] and force [N] of everyone who holds the object."""
    view = core.view
    if view is None:
        return []
    axes = len(view.object) // 2
    spans = [slice(axes * each, axes * (each + 1)) for each in range(len(view.seats))]
    return [(seat, view.proxies_m[span], view.forces_n[span]) for seat, span in zip(view.seats, spans, strict=True)]


def _vector(values: Sequence[float], scale: float, form: str) -> str:
    return " ".join(format(value * scale, form) for value in values)
