"""The server's end as blocks: one network step of each world, all N users at once.

Symbols: K_i, B_i, b_i coupling and impedance, c_i = sqrt(2 / b_i), e_i = x_si - x_o stretch, u_i, v_i waves in and
out, F_i force, x_o, v_o object, m_o, b_o its mass and damping, T = T_n. Every quantity is written as a row of
coefficients on [states | inputs], so that the formulas stand here as they stand in theory section 3. `stiffness` is
(..., N); leading axes are cases.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cogrip.analysis.linear.linear_session import LinearSession
from cogrip.analysis.linear.state_space import Array, StateSpace
from cogrip.devices.simulated.zero_order_hold import discretise
from cogrip.machine.addition import add_integers


def passive_step(session: LinearSession, stiffness: Array) -> StateSpace:
    """Return the step of theory sections 3.3 (midpoint) and 3.4 (implicit Euler, in touch), from u to v.

    States e, x_o, v_o (fixed: e alone).
    """
    N, T = len(session.people), session.frame_s
    b, c, B = _ports(session)
    moving = 0 if session.fixed else 2
    e, u = _rows(N, 0, 2 * N + moving), _rows(N, N + moving, 2 * N + moving)
    K = stiffness[..., None]
    G = K * (0.5 * T if session.midpoint else T) + B
    share = 1.0 / (1.0 + G / b)
    alpha = (K * e + G * c * u) * share
    beta = G * share
    if session.fixed:
        force = alpha
        relative = c * u - force / b
        return _block(K.shape[:-2], [e + T * relative], u - c * force)
    x_o, v_o = _rows(2, N, 2 * N + 2)
    inertia = session.object_mass_kg / T * (2.0 if session.midpoint else 1.0)
    pull = alpha.sum(axis=-2, keepdims=True)
    speed = (inertia * v_o + pull) / (inertia + session.object_damping_nspm + beta.sum(axis=-2, keepdims=True))
    force = alpha - beta * speed
    relative = c * u - force / b - speed
    after = 2.0 * speed - v_o if session.midpoint else speed
    return _block(K.shape[:-2], [e + T * relative, x_o + T * speed, after], u - c * force)


def paper_step(session: LinearSession, stiffness: Array) -> StateSpace:
    """Return P eq. 17, 18 with slips mended: the wave decoded with the force of the step before; from u to v.

    States e, x_o, v_o, F.
    """
    N, T = len(session.people), session.frame_s
    b, c, B = _ports(session)
    moving = 0 if session.fixed else 2
    size = 3 * N + moving
    e, old, u = _rows(N, 0, size), _rows(N, N + moving, size), _rows(N, 2 * N + moving, size)
    proxy = c * u - old / b
    K = stiffness[..., None]
    if session.fixed:
        force = K * (e + T * proxy) + B * proxy
        return _block(K.shape[:-2], [e + T * proxy, force], u - c * force)
    x_o, v_o = _rows(2, N, size)
    force = K * (e + T * proxy) + B * (proxy - v_o)
    moved, after = _held(session, v_o, force.sum(axis=-2, keepdims=True))
    return _block(K.shape[:-2], [e + T * proxy - moved, x_o + moved, after, force], u - c * force)


def coupled_step(session: LinearSession, stiffness: Array) -> StateSpace:
    """Return virtual coupling, theory section 5, from x_i, y_i of each user (place and velocity of the device) to x_o, v_o
    after the step, to each.

    States x_o, v_o.
    """
    N = len(session.people)
    if session.fixed:
        return StateSpace(np.zeros((0, 0)), np.zeros((0, 2 * N)), np.zeros((2 * N, 0)), np.zeros((2 * N, 2 * N)))
    _, _, B = _ports(session)
    size = 2 + 2 * N
    (x_o, v_o), hands = _rows(2, 0, size), _rows(2 * N, 2, size)
    force = stiffness[..., None] * (hands[0::2] - x_o) + B * (hands[1::2] - v_o)
    moved, after = _held(session, v_o, force.sum(axis=-2, keepdims=True))
    here = x_o + moved
    return _block(stiffness.shape[:-1], [here, after], np.concatenate((here, after) * N, axis=-2))


def _ports(session: LinearSession) -> tuple[Array, Array, Array]:
    """Return b, c, B as columns (N, 1)."""
    b = np.array([[person.impedance_nspm] for person in session.people])
    B = np.array([[person.damping_nspm] for person in session.people])
    return b, np.sqrt(2.0 / b), B


def _rows(count: int, first: int, size: int) -> Array:
    """Return rows that pick `count` entries from the `first` on, of `size` states and inputs."""
    return np.eye(size)[first : first + count]


def _held(session: LinearSession, v_o: Array, force: Array) -> tuple[Array, Array]:
    """Return displacement and velocity of the object after a frame under a held force: exact zero-order hold."""
    step = discretise(session.object_mass_kg, session.object_damping_nspm, 0.0, round(1.0 / session.frame_s))
    return step.p * v_o + step.g * force, step.q * v_o + step.h * force


def _block(batch: tuple[int, ...], states: Sequence[Array], outputs: Array) -> StateSpace:
    """Return a block from rows of coefficients on [states | inputs]: its states after the step, and its outputs."""
    heights = [1 if rows.ndim == 1 else rows.shape[-2] for rows in states]
    after = np.empty((*batch, add_integers(heights), outputs.shape[-1]))
    start = 0
    for rows, height in zip(states, heights, strict=True):
        after[..., start : start + height, :] = rows
        start += height
    return StateSpace(after[..., :start], after[..., start:], outputs[..., :start], outputs[..., start:])
