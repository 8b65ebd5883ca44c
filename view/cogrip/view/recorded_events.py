"""Events of a recording as marks on its time axis. What is told leaves out addresses: a page may go to anybody."""

from collections.abc import Sequence

from cogrip.protocol.texts import shown
from cogrip.view.scene import EventKind, SceneEvent

_VERBS: tuple[tuple[str, EventKind], ...] = (
    ("joined from", "joined"),
    ("resumed from", "joined"),
    ("left", "left"),
    ("has been silent", "lost"),
    ("was kicked", "kicked"),
    ("marker", "marker"),
    ("presses button", "button"),
    ("releases button", "button"),
)
"""Beginning of what an event says of a person -> kind."""
_CLIENT: dict[str, EventKind] = {
    "fault": "fault",
    "degraded": "other",
    "live": "other",
    "clutched": "other",
    "marker": "marker",
}


def server_event(time_s: float, text: str, room: str, names: Sequence[str]) -> SceneEvent | None:
    """Return a server's event, told as `<room>: <name> <words>`; a marker may be nobody's.

    None for one of another room, or of nobody who has a seat.
    """
    told = text.removeprefix(f"{room}: ")
    if told != text and told.startswith("marker: "):
        return SceneEvent(time_s, "marker", "", shown(told.removeprefix("marker: ")))
    who = next((name for name in sorted(names, key=len, reverse=True) if told.startswith(f"{name} ")), "")
    if told == text or not who:
        return None
    words = told.removeprefix(f"{who} ")
    kind: EventKind = next((kind for begin, kind in _VERBS if words.startswith(begin)), "other")
    if kind == "joined":
        words = words.partition(" ")[0]
    return SceneEvent(time_s, kind, who, shown(f"{who} {words}"))


def client_event(time_s: float, text: str, who: str) -> SceneEvent | None:
    """Return a change of state of a person's client, told as `<state>: <reason>`; None for one that nobody asks about."""
    state = text.partition(":")[0]
    kind = _CLIENT.get(state)
    return SceneEvent(time_s, kind, who, shown(f"{who}: {text}")) if kind else None
