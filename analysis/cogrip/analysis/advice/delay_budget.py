"""The delay between a hand's motion and the answer to it, stage by stage.

With waves: from the hand's motion through the forward wave, the server and the returning wave to the force, as the delay of
slow motion (the group delay at w -> 0). Ages are counted to the frame's end, when a frame is sent. The stages of a boxcar with
the displacement encoder make T_forward + T_back + T_n, the time of theory section 4, and L T_c where samples are L ticks old.
With a lowpass the compliance of theory 4 is a little larger, as the wave that a client sends back passes the filter too.

With virtual coupling: from a device's position as sent, through the object, to its position as held by a client.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import expm1

from cogrip.analysis.linear.linear_session import LinearPerson, LinearSession
from cogrip.machine.addition import add_floats
from cogrip.protocol.settings.delays import OneWayDelay
from cogrip.protocol.settings.rates import Rates


@dataclass(frozen=True, slots=True)
class Stage:
    """One stage of a path; direction: "up", "server", "down", or "client" where nothing of it crosses the network."""

    direction: str
    name: str
    delay_s: float
    why: str


def budget(session: LinearSession, user: int) -> tuple[Stage, ...]:
    """Return every stage of one user's round trip in order, those without delay included."""
    person = session.people[user]
    rates = person.rates
    if session.local:
        why = "the force of contact is held over a tick: half a tick on average"
        return (Stage("client", "hold", 0.5 * rates.tick_s, why),)
    hold = Stage("down", "hold", 0.5 * rates.frame_s, "an answer is held over a frame: half a frame on average")
    if not session.traits.waves:
        server = Stage("server", "step", 0.0, "a place is answered with the object after the step that it reaches")
        return (*_line("up", person.up, rates), server, *_line("down", person.down, rates), hold)
    return (
        _encoder(person, rates),
        _decimator(person, rates),
        *_filter(person, "up"),
        *_line("up", person.up, rates),
        Stage("server", "step", 0.0, "the wave is answered in the step that it reaches"),
        *_line("down", person.down, rates),
        *_filter(person, "down"),
        hold,
    )


def total_s(stages: tuple[Stage, ...]) -> float:
    """Return the delay of all stages [s]."""
    return add_floats(stage.delay_s for stage in stages)


def _encoder(person: LinearPerson, rates: Rates) -> Stage:
    T, old = rates.tick_s, person.latency_ticks
    late = f"; samples are {old} ticks old" if old else ""
    if person.encoder == "displacement":
        why = f"a tick's displacement is known at its end: half a tick old{late}"
        return Stage("up", "encoder", (0.5 + old) * T, why)
    if not person.estimated:
        return Stage(
            "up",
            "encoder",
            (1.0 + old) * T,
            f"a tick's velocity sample is from its start: one tick old at its end{late}",
        )
    # alpha-beta with memory m follows a ramp of velocity 2 m / (1 - m) ticks late, half a tick of which the position gives back
    lag = 2.0 * person.memory / (1.0 - person.memory) + 0.5 + old
    return Stage("up", "encoder", (1.0 + lag) * T, f"the velocity estimate of a tick's start, and its own lag{late}")


def _decimator(person: LinearPerson, rates: Rates) -> Stage:
    T = rates.tick_s
    if person.decimator == "boxcar":
        return Stage("up", "decimator", 0.5 * (rates.ticks_per_frame - 1) * T, "the mean of a frame is from its middle")
    if person.decimator == "lowpass":
        lag = T / expm1(person.lowpass_rad_s * T)
        return Stage("up", "decimator", lag, f"first-order filter at {person.lowpass_rad_s:g} rad/s")
    return Stage("up", "decimator", 0.0, "no filter: the last wave of a frame")


def _filter(person: LinearPerson, direction: str) -> tuple[Stage, ...]:
    why = "low-pass filter on the wave, for slow motion"
    return (Stage(direction, "wave filter", person.filter_lag_s, why),) if person.filter_lag_s else ()


def _line(direction: str, delay: OneWayDelay, rates: Rates) -> tuple[Stage, ...]:
    T = rates.tick_s
    return (
        Stage(direction, "link", delay.link_ticks * T, "as configured"),
        Stage(direction, "tick wait", delay.tick_wait_ticks * T, "to the receiver's next tick"),
        Stage(direction, "frame wait", delay.frame_wait_ticks * T, "to the next frame border"),
        Stage(direction, "playout", delay.playout_ticks * T, "kept in hand against jitter"),
    )
