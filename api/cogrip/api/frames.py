"""One moment of a session, as callbacks get it: the same of a virtual session, of an observed one and of one's own seat."""

from collections.abc import Mapping
from dataclasses import dataclass

from cogrip.client.core import ClientCore
from cogrip.client.observer import ObserverCore
from cogrip.machine.rows import Row
from cogrip.sim.laboratory import Laboratory


@dataclass(frozen=True, slots=True)
class HandState:
    """One person: where the hand is, in its own frame as its device has it [m], and the force on it [N] (the paper's eq. 9)."""

    position_m: Row
    force_n: Row


@dataclass(frozen=True, slots=True)
class Frame:
    """The object and the hands that hold it.

    number      of the network frame, or of the server's step
    time_s      since the session began, on the clock of who tells it
    object_m, object_mps    position [m] and velocity [m/s] of the object, shape (axes,)
    hands       by name
    """

    number: int
    time_s: float
    object_m: Row
    object_mps: Row
    hands: Mapping[str, HandState]


def of_laboratory(laboratory: Laboratory) -> Frame:
    """Return the frame that a virtual session has just run."""
    world = laboratory.room.world
    hands = {
        person.name: HandState(person.core.position_m, person.core.force_n)
        for number, person in enumerate(laboratory.people)
        if person.core.seated and laboratory.room.seats[number].on_object
    }
    state = tuple(world.position.tolist()), tuple(world.velocity.tolist())
    return Frame(laboratory.room.steps, laboratory.seconds, *state, hands)


def of_observer(core: ObserverCore, now_s: float) -> Frame | None:
    """Return the newest view of an observer, None before there is one. A hand is where its wave line has it at the server."""
    view = core.view
    if view is None:
        return None
    axes = len(view.object) // 2
    hands = {}
    for row, seat in enumerate(view.seats):
        span = slice(axes * row, axes * (row + 1))
        name = core.people[seat].name if seat in core.people else f"seat {seat}"
        hands[name] = HandState(view.proxies_m[span], view.forces_n[span])
    return Frame(view.number, now_s, view.object[:axes], view.object[axes:], hands)


def of_client(core: ClientCore, number: int) -> Frame:
    """Return what one client knows at a frame border: the object as last received, and its own hand, in its own frame."""
    state, seat = core.coupling.object_state, core.seat
    assert seat is not None
    axes = len(state) // 2
    hand = HandState(core.position_m, core.force_n)
    return Frame(number, number * seat.rates.frame_s, state[:axes], state[axes:], {seat.user: hand})
