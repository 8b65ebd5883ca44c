"""Haptic effects of a room (docs/effects.md): those of its settings and of its world, and how a player is told of them."""

from collections.abc import Mapping, Sequence, Set
from math import ceil

from cogrip.protocol.settings.effects import (
    LEAST_EVERY_S,
    MOST_EFFECTS,
    Effect,
    EffectSection,
    checked_effect,
    moved,
    unfit_effect,
)
from cogrip.protocol.settings.sections import Settings
from cogrip.protocol.wire.messages import Effects
from cogrip.protocol.wire.reliable import Unanswered
from cogrip.server.seats.markers import RoomMarkers

TOLD_HZ = 64  # messages a second while the client has not answered
SLOW_AFTER_S = 2.0  # time without an answer after which messages come at `SLOW_HZ`: the client may not know effects
SLOW_HZ = 4
ON, OFF = "on", "off"
KEPT_S = 2.0  # time for which an effect that ends by itself is told beyond its end: it may have come late


class RoomEffects:
    """Effects of `[[effects]]`, as of a step."""

    def __init__(self, settings: Settings, begun_step: int = 0) -> None:
        """begun_step: step from which the times of the settings count."""
        self._frame_s = 1.0 / settings.rates.network_hz
        self._sections = settings.effects
        self._users = [user.name for user in settings.users]
        self._marked: list[int | None] = [None if section.marker else begun_step for section in self._sections]
        self._looked = begun_step  # step from which on markers are new
        self._turns: list[tuple[int, int] | None] = [None] * len(self._sections)
        self._effects: list[Effect | None] = [None] * len(self._sections)
        self._of: list[tuple[Effect, ...]] = [()] * len(self._users)
        self._set: list[tuple[str, ...] | None] = [None] * len(self._sections)  # for whom, of what was set
        self._set_step: dict[str, int] = {}  # last step in which an effect was set, by name

    def unfit(self, switches: Mapping[str, str], step: int) -> str:
        """Return why effects cannot be switched so (`RoomChange.effects`), with the cure; "" where they can."""
        names = [section.name for section in self._sections if section.name]
        for name, value in switches.items():
            if name not in names:
                return f"there is no effect {name!r}; there is: {', '.join(names) or 'none with a name'}"
            if value not in (ON, OFF) and (unknown := set(value.split(",")) - set(self._users)):
                return f"effects.{name}: there is no user {min(unknown)!r}; name one of {', '.join(self._users)}"
            places = [place for place, section in enumerate(self._sections) if section.name == name]
            begun = self._set_step.get(name), self._marked[places[0]]
            since_s = min([(step - each) * self._frame_s for each in begun if each is not None], default=LEAST_EVERY_S)
            if since_s < LEAST_EVERY_S:
                wait = f"wait {LEAST_EVERY_S:g} s from one switch to the next"
                return f"effects.{name} was set, or its marker came, {since_s:.3f} s ago; {wait}"
        return ""

    def switch(self, switches: Mapping[str, str], step: int, resumed: bool = False) -> None:
        """Begin effects anew, or end them (`unfit`). One that was ended waits for no marker, but to be switched on.

        resumed: by a checkpoint: one that ends by itself was felt before, and does not begin again
        """
        for place, section in enumerate(self._sections):
            if not section.name or (value := switches.get(section.name)) is None:
                continue
            self._set_step[section.name] = step
            self._set[place] = {ON: section.users or tuple(self._users), OFF: ()}.get(value, tuple(value.split(",")))
            over = value == OFF or (resumed and section.seconds > 0.0 and not section.every_s)
            self._marked[place] = None if over else step - ceil(section.start_s / self._frame_s)

    def follow(self, step: int, markers: RoomMarkers) -> None:
        """Begin what begins with this step. markers: of the room, with which effects may begin."""
        if not self._sections:
            return
        for mark in markers.since(self._looked):
            for place, section in enumerate(self._sections):
                begun = [each for each in (self._marked[place], self._set_step.get(section.name)) if each is not None]
                fresh = not begun or (mark.step - max(begun)) * self._frame_s >= LEAST_EVERY_S
                if section.marker and section.marker == mark.text and fresh and self._set[place] != ():
                    self._marked[place] = mark.step
        self._looked = step
        turns = [
            None if marked is None else self._turn(section, marked, step)
            for section, marked in zip(self._sections, self._marked, strict=True)
        ]
        if turns == self._turns:
            return
        for place, (section, turn) in enumerate(zip(self._sections, turns, strict=True)):
            if turn != self._turns[place]:
                self._effects[place] = None if turn is None else section.begun()
        self._turns = turns
        for user, name in enumerate(self._users):
            mine = [effect for place, effect in enumerate(self._effects) if effect and self._is_for(place, name)]
            self._of[user] = tuple(mine)

    def _is_for(self, place: int, name: str) -> bool:
        users = self._set[place]
        return name in (self._sections[place].users or (name,) if users is None else users)

    def _turn(self, section: EffectSection, marked: int, step: int) -> tuple[int, int] | None:
        """Return from which step its time counts, and how often it has begun, less 1; None before it begins."""
        since_s = (step - marked) * self._frame_s - section.start_s
        if since_s < 0.0:
            return None
        return marked, int(since_s / section.every_s) if section.every_s else 0

    def of(self, user: int) -> tuple[Effect, ...]:
        """Return those of one user."""
        return self._of[user]


class EffectSender:
    """Effects that one seat session is told. An effect is repeated until the client has answered that it knows it.

    refused  why effects were refused since its owner emptied it
    """

    def __init__(self, network_hz: int, axes: int, tank_mj: float) -> None:
        self._axes, self._tank_mj, self._hz = axes, tank_mj, network_hz
        self._every, self._slow = max(1, network_hz // TOLD_HZ), max(1, network_hz // SLOW_HZ)
        self._given: Sequence[Effect] = ()
        self._offset: tuple[float, ...] = ()
        self._told: dict[
            int, tuple[int, Effect, Effect, int | None]
        ] = {}  # by id: number, as given, as told, last step
        self._over: dict[int, Effect] = {}  # by id: ended by themselves, or refused, and still given
        self._unknown: Unanswered[Effect] = Unanswered()  # to the client, of those in `_told`
        self._version = self._changed = self._turn = 0
        self._answered = True
        self.refused: list[str] = []

    def follow(self, given: Sequence[Effect], offset_m: Sequence[float], step: int) -> None:
        """Tell these from now on, moved by `offset_m` into the hand's own frame."""
        offset = tuple(offset_m)
        before = list(self._told)
        if offset != self._offset:
            self._told = {key: each for key, each in self._told.items() if each[3] is not None}
            self._offset = offset
        elif given is self._given and not any(each[3] is not None for each in self._told.values()):
            return
        ids = {id(each) for each in given}
        for key, (_, _, _, last) in list(self._told.items()):
            if last is None and key not in ids:
                del self._told[key]
            elif last is not None and step > last:
                self._over[key] = self._told.pop(key)[1]
        self._over = {key: each for key, each in self._over.items() if key in ids}
        if given is not self._given or len(self._told) + len(self._over) < len(ids):
            self._add(given, step)
        self._given = given
        if list(self._told) != before:
            self._version += 1
            self._changed, self._answered = step, False
            self._forget_all_but({number for number, *_ in self._told.values()})

    def _add(self, given: Sequence[Effect], step: int) -> None:
        for effect in given:
            if id(effect) in self._told or id(effect) in self._over:
                continue
            checked = checked_effect(effect)
            why = checked if isinstance(checked, str) else unfit_effect(checked, self._axes)
            if not why and len(self._told) >= MOST_EFFECTS:
                why = f"more than {MOST_EFFECTS} at once"
            if why:
                self.refused.append(why)
                self._over[id(effect)] = effect  # said once
                continue
            ends = effect.seconds and not effect.waits
            last = step + round((effect.seconds + KEPT_S) * self._hz) if ends else None
            told = moved(effect, self._offset)
            self._told[id(effect)] = self._unknown.add(told), effect, told, last

    def _forget_all_but(self, numbers: Set[int]) -> None:
        for number, _ in list(self._unknown.waiting):
            if number not in numbers:
                self._unknown.answered_one(number)

    def receive(self, answer: Effects) -> bool:
        """Take in which effects the client knows; False where it cannot know them."""
        if answer.version > self._version or answer.effect is not None:
            return False
        self._forget_all_but({number for number, _ in self._unknown.waiting}.difference(answer.numbers))
        self._answered = answer.version == self._version and not self._unknown.waiting
        return True

    def next(self, session: int, step: int) -> Effects | None:
        """Return what is told after this step."""
        slow = step - self._changed > SLOW_AFTER_S * self._hz
        if self._answered or (step - self._changed) % (self._slow if slow else self._every):
            return None
        numbers = tuple([number for number, *_ in self._told.values()])
        left = self._unknown.waiting
        if not left:
            return Effects(session, self._version, numbers, self._tank_mj)
        self._turn += 1
        number, effect = left[self._turn % len(left)]
        return Effects(session, self._version, numbers, self._tank_mj, number, effect)
