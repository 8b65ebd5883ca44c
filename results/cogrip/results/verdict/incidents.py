"""Incidents of a run, from its summary: what was unstable, saturated, or left the workspace. Three things, three names.

unstable   numbers that are not finite or grow, a force that oscillated until it was a fault: the session has failed
saturated  a force that sat at its device's limit, and was let go
left       a hand, the object or a body of a scene that went out of the workspace
"""

from typing import Any, Literal

from cogrip.results.reading.summary_values import Summary, dig, is_number, name_of, people, seat_sessions, vector
from cogrip.results.verdict.judgement import names_of, some

Incident = Literal["unstable", "saturated", "left"]
INCIDENTS: tuple[Incident, ...] = ("unstable", "saturated", "left")


def is_unstable(summary: Summary) -> bool | None:
    """Return whether a run was unstable; None where no end said it."""
    found = summary.get("unstable")
    return found if isinstance(found, bool) else None


def word_of(summary: Summary) -> str:
    """Return the name of the gravest incident that was no instability, "" where there was none."""
    return "saturated" if _saturated(summary) else "left" if _left(summary) else ""


def why_unstable(summary: Summary) -> list[str]:
    """Return the reasons why a run was unstable."""
    found = [
        f"{name_of(user)}: {user['reason']}"
        for user in people(summary)
        if user.get("reason") and not user.get("claimed") and user.get("unstable") is True
    ]
    if failed := dig(summary, "server", "world_failed"):
        found.insert(0, f"The world has ended: {failed}")
    elif world := dig(summary, "server", "unstable"):
        found.insert(0, str(world))
    if found:
        return found
    where = vector(dig(summary, "object", "position_m"), scale=1e3)
    return [f"numbers grew out of bounds; the object was last at {where} mm"]


def incidents(summary: Summary) -> list[tuple[str, str]]:
    """Return what saturated and what left, each in words and in brief; nothing where nothing did."""
    found = []
    if saturated := _saturated(summary):
        text = f"the force on {some(saturated)} sat at the device's limit, and was let go"
        found.append((text, f"saturated ({some(saturated)})"))
    if left := _left(summary):
        texts = [f"{what} left the workspace{when}" for what, when in left]
        rest = f" and {len(texts) - 3} more" if texts[3:] else ""
        found.append((f"{', '.join(texts[:3])}{rest}", f"left ({some(what for what, _ in left)})"))
    return found


def ended_saturated(summary: Summary) -> bool:
    """Return whether somebody ended in the fault of a force that sat at its limit."""
    return any(user.get("saturated") is True and user.get("state") == "fault" for user in people(summary))


def _saturated(summary: Summary) -> list[str]:
    return names_of(row for row in seat_sessions(people(summary)) if row.get("saturated") is True)


def _left(summary: Summary) -> list[tuple[str, str]]:
    """Return what left, and when as far as that is known."""
    bodies: list[Any] = table if isinstance(table := dig(summary, "server", "left"), list) else []
    found = [
        (str(body["what"]), f" after {body['at_s']:.2f} s" if is_number(body.get("at_s")) else "")
        for body in bodies
        if isinstance(body, dict) and body.get("what")
    ]
    hands = names_of(row for row in seat_sessions(people(summary)) if row.get("left") is True)
    if not found and not hands and summary.get("left") is True:  # a client knows no more
        found = [("the object", "")]
    return [*((f"the hand of {name}", "") for name in hands), *found]
