"""The impedance that a session renders to a hand, over frequency, and its stiffness, damping and inertia at low frequency.

One user's hand moves its device as x(t) = X e^{j w t}, whatever the force; all else answers. With y = j w x, the device's
motors give

    Z(w) = F(w) / y        F(w) = (1/M) sum_k F_k e^{-j w k T_c}

the component at w of the force's samples; a force held over frames also has images at w + 2 pi n / T_n, which do not
count. The impedance of the device itself, j w m + b_HD with its mass m and damping b_HD, adds to Z (`device_impedance`).

Everything is a phasor per network frame, z = e^{j w T_n}. The moving client's port, with s(w) its encoder's output for the
motion and V the returning wave held over a frame, is u = E + R V with E = D(w) sqrt(2b) s(w) y, D and R the decimator's
answers to a tone and to a held wave. The port of another client j is u_j = G_j V, and the server's v = S u, over all clients.
With i the moving client, e_i its unit vector and G the diagonal of R and all G_j, (I - S G) v = S e_i E.

Symbols as in `client_blocks`; frequencies w [rad/s] of shape (W,).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import pi, sqrt

import numpy as np

from cogrip.analysis.linear.client_blocks import booked_late, decimator_row
from cogrip.analysis.linear.decimation_passivity import filter_of, lowpass_pole
from cogrip.analysis.linear.lifted_model import KINDS
from cogrip.analysis.linear.linear_session import LinearPerson, LinearSession
from cogrip.analysis.linear.state_space import Array, Complex
from cogrip.client.hand.velocity import hand_memory, observer_gains
from cogrip.protocol.settings.rates import Rates

LOWEST_HZ, HIGHEST_HZ, POINTS = 0.1, 64.0, 200
_SLOW_RAD_S = (1e-3, 0.25, 0.5)


def frequencies_hz(rates: Rates) -> Array:
    """Return the usual frequencies of an impedance, shape (POINTS,).

    They end just below half the network rate, if that is less: there a tone and its image coincide.
    """
    return np.geomspace(LOWEST_HZ, min(HIGHEST_HZ, 0.5 * rates.network_hz * (1.0 - 1e-4)), POINTS)


# The four conditions: what the session looks like to one user.


def no_contact(session: LinearSession, user: int) -> LinearSession:
    """Return the session of a hand that touches nothing: the wave returns unchanged."""
    person = replace(session.people[user], stiffness_npm=0.0, damping_nspm=0.0)
    return replace(session, people=(person,), fixed=True, midpoint=False)


def alone(session: LinearSession, user: int) -> LinearSession:
    """Return the session of one user alone with the object."""
    return replace(session, people=(session.people[user],), fixed=False)


def on_wall(session: LinearSession, user: int) -> LinearSession:
    """Return the session of one user in lasting contact with an object that cannot move."""
    return replace(session, people=(session.people[user],), fixed=True, midpoint=False)


def held(session: LinearSession, user: int, hand_stiffness_npm: float, hand_damping_nspm: float) -> LinearSession:
    """Return the session with everybody else holding on with such a hand [N/m, N s/m]."""
    people = [
        person
        if number == user
        else replace(person, hand_stiffness_npm=hand_stiffness_npm, hand_damping_nspm=hand_damping_nspm)
        for number, person in enumerate(session.people)
    ]
    return replace(session, people=tuple(people), fixed=False)


def impedance(session: LinearSession, user: int, omega_rad_s: Array) -> Complex:
    """Return Z [N s/m] at w, shape (W,), of the session as it stands: hands of others are theirs in `session`."""
    person = session.people[user]
    rates = person.rates
    w = np.asarray(omega_rad_s, dtype=float)
    z = np.exp(1j * w * rates.frame_s)
    kind = KINDS[session.form]
    width, N = kind.width, len(session.people)
    K = np.array(session.stiffness_npm)
    server = kind.server(session, K).response(z)
    G = np.zeros((len(w), width * N, width * N), dtype=np.complex128)
    for number, other in enumerate(session.people):
        mine = slice(number * width, (number + 1) * width)
        frames = other.up_frames + other.down_frames + kind.server_delay
        if number == user:
            answer = reflected(other, rates, z) if width == 1 else np.zeros((len(w), width, width))
        else:
            answer = kind.client(other, K[number], other.rates).response(z)
        G[:, mine, mine] = answer * (z**-frames * other.filtered(z) ** 2)[:, None, None]
    port = _wave_port if session.traits.waves else _coupled_port
    sent, law = port(person, rates, w)
    drive = np.zeros((len(w), width * N, 1), dtype=np.complex128)
    mine = slice(user * width, (user + 1) * width)
    filtered = person.filtered(z)[:, None]
    drive[:, mine, 0] = sent * filtered * z[:, None] ** -person.up.frames
    answers = np.linalg.solve(np.eye(width * N) - server @ G, server @ drive)[:, mine, 0]
    seen = answers * filtered * z[:, None] ** -(person.down.frames + kind.server_delay)
    return law(seen * _held(rates, w)[:, None])


def device_impedance(session: LinearSession, user: int, omega_rad_s: Array) -> Complex:
    """Return the bare device's j w m + b_HD [N s/m]."""
    person = session.people[user]
    return np.asarray(1j * omega_rad_s * person.device_mass_kg + person.device_damping_nspm, dtype=np.complex128)


def ideal_impedance(session: LinearSession, user: int, omega_rad_s: Array) -> Complex:
    """Return Z of direct contact [N s/m]: springs, dampers, masses and hands in continuous time, without a line."""
    s = 1j * np.asarray(omega_rad_s, dtype=float)
    own = _spring(session.people[user], s)
    if session.fixed:
        return own
    others = session.object_mass_kg * s + session.object_damping_nspm
    for number, other in enumerate(session.people):
        if number != user:
            hand = other.hand_stiffness_npm / s + other.hand_damping_nspm
            others = others + _in_series(_spring(other, s), other.device_mass_kg * s + other.device_damping_nspm + hand)
    return _in_series(own, others)


@dataclass(frozen=True, slots=True)
class Slow:
    """The felt spring [N/m], damper [N s/m] and mass [kg] of F = K x + B x' + M x'' as w goes to 0."""

    stiffness_npm: float
    damping_nspm: float
    inertia_kg: float


def slow_feel(session: LinearSession, user: int) -> Slow:
    """Return K, B, M of the impedance's expansion j w Z = K + j w B - w^2 M + ..., the device apart.

    K is read at 1e-3 rad/s, exact to 1e-9; B and M at 0.25 and 0.5 rad/s, extrapolated (their next terms are of order w^2).
    """
    w = np.array(_SLOW_RAD_S)
    stiff = 1j * w * impedance(session, user, w)
    B = stiff[1:].imag / w[1:]
    M = (stiff[0].real - stiff[1:].real) / w[1:] ** 2
    damping, inertia = (float((4.0 * value[0] - value[1]) / 3.0) for value in (B, M))
    return Slow(float(stiff[0].real) + inertia * _SLOW_RAD_S[0] ** 2, damping, inertia)


def _spring(person: LinearPerson, s: Complex) -> Complex:
    return np.asarray(person.stiffness_npm / s + person.damping_nspm, dtype=np.complex128)


def _in_series(one: Complex, other: Complex) -> Complex:
    """Return the impedance of two that carry one force."""
    total = one + other
    return np.asarray(np.divide(one * other, total, out=np.zeros_like(total), where=total != 0.0), dtype=np.complex128)


def _held(rates: Rates, w: Array) -> Complex:
    """Return the component at w of a signal that is held over each frame's M ticks."""
    ticks = np.arange(rates.ticks_per_frame)
    return np.asarray(np.exp(-1j * w[:, None] * ticks * rates.tick_s).mean(axis=1), dtype=np.complex128)


def _velocity_sample(person: LinearPerson, rates: Rates, w: Array) -> tuple[Complex, Complex]:
    """Return the velocity in the force law for y = 1, and for a force of 1: exact, or that of `MotionObserver`."""
    if not person.estimated:
        return _late(person, rates, w), np.zeros(len(w), dtype=np.complex128)
    T, L, tick = rates.tick_s, person.latency_ticks, np.exp(1j * w * rates.tick_s)
    alpha, beta, gamma = observer_gains(person.memory, hand_memory(T) if person.observes else 1.0)
    gain, step = (
        np.array([alpha, beta / T, gamma / T**2]),
        np.array([[1.0, T, 0.5 * T * T], [0.0, 1.0, T], [0.0, 0.0, 1.0]]),
    )
    corrected = np.eye(3) - np.outer(gain, [1.0, 0.0, 0.0])
    pushed = corrected @ np.array([-0.5 * T * T, -T, 0.0]) / person.assumed_mass_kg
    inputs = np.stack(
        (gain * (tick * _late(person, rates, w) / (1j * w))[:, None], pushed * tick[:, None] ** -L), axis=-1
    )
    place = np.linalg.solve(tick[:, None, None] * np.eye(3) - corrected @ step, inputs)
    seen: Complex = np.asarray(place[:, 1] + L * T * place[:, 2], dtype=np.complex128)
    since = np.zeros(len(w), dtype=np.complex128)
    for age in range(1, L + 1):
        since += tick**-age
    return seen[:, 0], seen[:, 1] - since * T / person.assumed_mass_kg


def _late(person: LinearPerson, rates: Rates, w: Array) -> Complex:
    """Return the factor of a sample's age."""
    return np.asarray(np.exp(-1j * w * person.latency_ticks * rates.tick_s), dtype=np.complex128)


def encoded(person: LinearPerson, rates: Rates, w: Array) -> Complex:
    """Return s(w): the velocity in the waves of a tick, for y = 1 at the tick's start."""
    if person.encoder == "velocity":
        return _velocity_sample(person, rates, w)[0]
    turn = 1j * w * rates.tick_s
    return np.asarray(np.expm1(turn) / turn * _late(person, rates, w), dtype=np.complex128)


def decimated(person: LinearPerson, rates: Rates, w: Array) -> Complex:
    """Return D(w): the wave of a frame, for a tone of 1 at the frame's first tick."""
    turn = w * rates.tick_s
    last = np.exp(1j * turn * (rates.ticks_per_frame - 1))
    return np.asarray(
        last * filter_of(person.decimator, rates, person.lowpass_rad_s).response(turn), dtype=np.complex128
    )


def reflected(person: LinearPerson, rates: Rates, z: Complex) -> Complex:
    """Return R, shape (W, 1, 1): the wave that a client sends back whose device is held still."""
    ticks = np.arange(rates.ticks_per_frame)
    before = person.split_ticks + booked_late(person)
    held = z[:, None] ** ((ticks - before) // rates.ticks_per_frame)  # by the frame that it came in
    row: Array | Complex = decimator_row(person, rates.ticks_per_frame)
    if person.decimator == "lowpass":
        pole = lowpass_pole(person.lowpass_rad_s, rates)
        row = (1.0 - pole) * pole ** ticks[::-1] / (1.0 - pole**rates.ticks_per_frame / z[:, None])
    return np.asarray(-(held * row).sum(axis=1)[:, None, None], dtype=np.complex128)


Law = Callable[[Complex], Complex]
"""A function from the returned signals, (W, width), to the force of y = 1, (W,)."""


def _wave_port(person: LinearPerson, rates: Rates, w: Array) -> tuple[Complex, Law]:
    b, root = person.impedance_nspm, sqrt(2.0 * person.impedance_nspm)
    sent = (root * decimated(person, rates, w) * encoded(person, rates, w))[:, None]
    read, pushed = _velocity_sample(person, rates, w)
    return sent, lambda back: np.asarray((b * read - root * back[:, 0]) / (1.0 - b * pushed), dtype=np.complex128)


def _coupled_port(person: LinearPerson, rates: Rates, w: Array) -> tuple[Complex, Law]:
    K, B = person.stiffness_npm, person.damping_nspm
    read, pushed = _velocity_sample(person, rates, w)
    state = np.stack((_late(person, rates, w) / (1j * w), read), axis=1)
    law = np.array([K, B])
    return state, lambda back: np.asarray((state - back) @ law / (1.0 - B * pushed), dtype=np.complex128)


@dataclass(frozen=True, slots=True)
class Condition:
    """One kind of contact: impedance rendered and ideal, (W,) [N s/m], and the slow feel."""

    name: str
    rendered: Complex
    ideal: Complex
    slow: Slow


def conditions(
    session: LinearSession,
    user: int,
    frequency_hz: Array,
    *,
    hand_stiffness_npm: float = 300.0,
    hand_damping_nspm: float = 5.0,
) -> tuple[Condition, ...]:
    """Return all conditions that apply: no contact, alone, on a wall, others hold on (the last not for a wall)."""
    cases = {"no contact": no_contact(session, user)}
    if not session.fixed:
        cases["alone with the object"] = alone(session, user)
    cases["on a wall"] = on_wall(session, user)
    if not session.fixed and len(session.people) > 1:
        cases["others hold on"] = held(session, user, hand_stiffness_npm, hand_damping_nspm)
    w = 2.0 * pi * np.asarray(frequency_hz)
    found = []
    for name, case in cases.items():
        index = user if name == "others hold on" else 0
        found.append(
            Condition(name, impedance(case, index, w), ideal_impedance(case, index, w), slow_feel(case, index))
        )
    return tuple(found)
