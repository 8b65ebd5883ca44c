"""A run's summary in sentences, for the report and the terminal: three judgements, then notes."""

from collections.abc import Iterator

from cogrip.protocol.scene_words import as_sentence, unused_words
from cogrip.results.reading.summary_values import (
    Summary,
    dig,
    energy,
    is_number,
    name_of,
    people,
    seat_sessions,
    share,
    task_goals,
    task_of,
    task_result,
    ticks_share,
)
from cogrip.results.verdict.judgement import Tone, never_taken
from cogrip.results.verdict.verdict import judgements

_BALANCE_J = 1e-9  # largest energy by which rounding can put out the balance of one step, generously
_SHOWN_PEOPLE = 6
MUCH_LATE, MANY_LATE = 0.05, 20  # share and number of one direction's late frames from which on a depth is too shallow


def verdict(summary: Summary) -> list[tuple[Tone, str]]:
    """Return sentences, each with its tone."""
    if not summary:
        return [("bad", "There is no summary of this run: only what its traces hold can be shown.")]
    return [
        *((judgement.tone, judgement.sentence) for judgement in judgements(summary)),
        *_task(summary),
        *((tone, sentence) for tone, sentence, _ in notes(summary)),
    ]


def notes(summary: Summary) -> Iterator[tuple[Tone, str, str]]:
    """Yield sentences beside the three judgements, each with its tone and, in a word or two, its subject."""
    for about, sentences in (
        ("energy balance", _balance), ("energy limiter", _limited), ("not used", _unused), ("mocap bodies", _slowed),
        ("ended badly", _states), ("late frames", _late), ("ticks missed", _loops),
    ):  # fmt: skip
        for tone, sentence in sentences(summary):
            yield tone, sentence, about


def _task(summary: Summary) -> Iterator[tuple[Tone, str]]:
    if task := task_of(summary):
        goals = "; ".join(f"{words} {value}" for words, value in task_goals(task))
        tone: Tone = "good" if task.get("reached") is True else "warn"
        yield tone, f"Task {task_result(task)}: {task.get('body')} {goals}."


def _balance(summary: Summary) -> Iterator[tuple[Tone, str]]:
    error_j = dig(summary, "server", "energy_balance_error_j")
    if is_number(error_j) and error_j > _BALANCE_J:
        yield "warn", f"The object's step does not balance its energy: one step made or lost up to {energy(error_j)}."


def _limited(summary: Summary) -> Iterator[tuple[Tone, str]]:
    frames, paid_j = (dig(summary, "server", "energy_limiter", key) for key in ("limited_frames", "paid_j"))
    if is_number(frames) and is_number(paid_j) and frames > 0:
        text = (
            f"The scene's {_sources(summary)} made energy: its limiter took {energy(paid_j)} from the returning waves in "
            f"{frames:g} frames, and hands felt less force; see docs/worlds.md."
        )
        yield "warn", text


def _sources(summary: Summary) -> str:
    if dig(summary, "server", "scene", "mocap_slowed") is not None:
        return "contacts, actuators or script"
    return "contacts or actuators" if dig(summary, "server", "scene", "actuators") else "contacts"


def _unused(summary: Summary) -> Iterator[tuple[Tone, str]]:
    if texts := dig(summary, "server", "scene", "unused"):
        yield "warn", as_sentence(unused_words([str(text) for text in texts]))


def _slowed(summary: Summary) -> Iterator[tuple[Tone, str]]:
    times = dig(summary, "server", "scene", "mocap_slowed")
    if is_number(times) and times > 0:
        yield (
            "warn",
            f"A script put mocap bodies farther than they may go, {times:g} times: they went as fast as they may.",
        )


def _states(summary: Summary) -> Iterator[tuple[Tone, str]]:
    for user in people(summary):
        state, reason = user.get("state"), user.get("reason")
        if state is None:
            if never_taken(user):
                yield "warn", f"Nobody took the seat of {name_of(user)}."
                continue
            silent = "never sent anything" if dig(user, "link", "up", "received") == 0 else "reported no account"
            yield "warn", f"The client of {name_of(user)} {silent}: what it alone knows is missing."
        elif state in ("fault", "degraded") and not user.get("unstable"):
            said = ", its client says" if user.get("claimed") else ""
            yield (
                ("bad" if state == "fault" else "warn"),
                f"{name_of(user)} ended in {state}{said}: {reason or 'no reason given'}.",
            )
        elif isinstance(reason, str) and "kicked" in reason:
            yield "warn", f"{name_of(user)} did not leave by choice: {reason}."


def _late(summary: Summary) -> Iterator[tuple[Tone, str]]:
    """Yield a warning of a playout depth that was set too shallow for the network; only waves are played out."""
    frames = summary.get("playout_frames")
    if not is_number(frames):
        return  # it follows the network, or nobody says
    found = []
    for user in seat_sessions(people(summary)):
        for direction in ("up", "down"):
            late, sent = dig(user, "link", direction, "late"), dig(user, "link", direction, "sent")
            if not (dig(user, "playout", direction) and is_number(late) and is_number(sent)):
                continue
            if late >= max(MANY_LATE, MUCH_LATE * sent):
                found.append((late / max(late, sent), "from" if direction == "up" else "to", name_of(user)))
    if found:
        part, direction, name = max(found)
        others = f" (and 5 % or more in {len(found) - 1} of the other directions)" if len(found) > 1 else ""
        text = (
            f"{100.0 * part:.0f} % of the frames {direction} {name}{others} came too late for playout.frames = {frames} "
            'and were not played: a larger number waits for more of them, "auto" follows the network.'
        )
        yield "warn", text


def _loops(summary: Summary) -> Iterator[tuple[Tone, str]]:
    loops = [(name_of(user), user.get("ticks")) for user in people(summary)]
    loops.append(("the server", dig(summary, "server", "ticks")))
    shares = [(part, name) for name, ticks in loops if (part := ticks_share(ticks)) is not None]
    if not shares:
        yield "warn", "How many ticks were run is not known."
        return
    least = min(shares)[0]
    if least >= 1.0:
        text = "Every loop ran every tick"
    elif len(shares) <= _SHOWN_PEOPLE:
        text = "Ticks run: " + ", ".join(f"{name} {share(part)}" for part, name in shares)
    else:
        text = f"Ticks run: {share(least)} at worst, by {min(shares)[1]}"
    late = [(value, name) for name, ticks in loops if is_number(value := dig(ticks, "late_us", "p99"))]
    if late:
        value, name = max(late)
        text += f"; 99 of 100 ticks came within {value:.0f} µs of their time (the latest: {name})"
    yield ("good" if least >= 0.999 else "warn" if least >= 0.99 else "bad"), f"{text}."
