"""The client's end as blocks: device, velocity estimate, force law, encoder, filter and decimator; tick by tick, then lifted.

Symbols, per axis: x, y = x' device position [m] and velocity [m/s], y_est what the force law reads, w = (x_{k+1} -
x_k)/T_c mean velocity of a tick, F force on the device [N], u forward and v returning wave [sqrt(W)], x_o, v_o the
object's last known state, b wave impedance, K, B coupling, T_c tick, M ticks in a frame, L age of a sample in ticks when it
is read.
"""

from __future__ import annotations

from math import sqrt

import numpy as np

from cogrip.analysis.linear.decimation_passivity import lowpass_pole
from cogrip.analysis.linear.linear_session import LinearPerson
from cogrip.analysis.linear.state_space import Array, StateSpace, close, delay, diagonal, lift, series, through
from cogrip.client.hand.velocity import hand_memory, observer_gains
from cogrip.devices.simulated.zero_order_hold import discretise
from cogrip.protocol.settings.rates import Rates


def device_block(person: LinearPerson, rates: Rates) -> StateSpace:
    """Return the device with its estimator: input F, held over a tick; outputs y_est, w and x as read (P eq. 9; F_h apart).

    States: x, y; the observer's if estimated (its place less that read, velocity, acceleration by the hand, F of the last L
    ticks, newest first), else y of the last L ticks, newest first; w of the last L ticks, for samples that are L ticks old when
    read. The observer is `MotionObserver`: it reads displacements alone, and the F that made them.
    """
    step = discretise(
        person.device_mass_kg,
        person.device_damping_nspm + person.hand_damping_nspm,
        person.hand_stiffness_npm,
        rates.device_hz,
    )
    L, T = person.latency_ticks, rates.tick_s
    own, past = _layout(person)
    n = own + 2 + L
    A, B, C, D = np.zeros((n, n)), np.zeros((n, 1)), np.zeros((3, n)), np.zeros((3, 1))
    A[:2, :2] = [[1.0 - step.g * step.stiffness_npm, step.p], [-step.h * step.stiffness_npm, step.q]]
    B[:2, 0] = -step.g, -step.h
    w, driven = np.zeros(n), B[0] * rates.device_hz
    w[:2] = (A[0, :2] - (1.0, 0.0)) * rates.device_hz
    _remember(A, B, past, w, driven)
    C[1], D[1] = (np.eye(n)[-1], 0.0) if L else (w, driven)
    C[2, 0] = 1.0
    C[2, past] = -T
    if person.estimated:
        _observe(person, rates, A, B, C, D)
    else:
        _remember(A, B, slice(2, 2 + L), np.eye(n)[1], np.zeros(1))
        C[0, 1 + L] = 1.0
    return StateSpace(A, B, C, D)


def _observe(person: LinearPerson, rates: Rates, A: Array, B: Array, C: Array, D: Array) -> None:
    """Enter the observer of a device whose samples show displacements C[1], D[1] times T_c."""
    L, T = person.latency_ticks, rates.tick_s
    alpha, beta, gamma = observer_gains(person.memory, hand_memory(T) if person.observes else 1.0)
    off, v, a, held = 2, 3, 4, slice(5, 5 + L)
    gained, driven = np.zeros(len(A)), np.zeros(1)  # velocity that the observer expects to be gained in a tick
    per_newton = T / person.assumed_mass_kg
    if person.observes:
        gained[a] = T
        if L:
            gained[held.stop - 1] = -per_newton
        else:
            driven[0] = -per_newton
    error, error_driven = T * C[1] - 0.5 * T * gained, T * D[1] - 0.5 * T * driven
    error[off] -= 1.0
    error[v] -= T
    A[off], B[off] = (alpha - 1.0) * error, (alpha - 1.0) * error_driven
    A[v], B[v] = gained + beta / T * error, driven + beta / T * error_driven
    A[v, v] += 1.0
    C[0, v] = 1.0
    if not person.observes:
        return
    A[a], B[a] = gamma / T**2 * error, gamma / T**2 * error_driven
    A[a, a] += 1.0
    _remember(A, B, held, np.zeros(len(A)), np.ones(1))
    C[0, a], C[0, held] = L * T, -per_newton


def _layout(person: LinearPerson) -> tuple[int, slice]:
    """Return the number of states for y_est, and the slice of w of the last ticks."""
    own = (3 if person.observes else 0) + person.latency_ticks
    if person.estimated and not person.observes:
        own = 2
    return own, slice(2 + own, 2 + own + person.latency_ticks)


def _remember(A: Array, B: Array, states: slice, row: Array, driven: Array) -> None:
    """Enter states that hold the last values of a signal, newest first."""
    first, end = states.start, states.stop
    if end > first:
        A[first], B[first] = row, driven
        A[first + 1 : end, first : end - 1] = np.eye(end - first - 1)


def gliding(person: LinearPerson) -> tuple[slice, ...]:
    """Return the states of a client that are v while everything moves on at v: y, its estimate, and their past values."""
    own, past = _layout(person)
    return (slice(1, 2), slice(3, 4), past) if person.estimated else (slice(1, 2 + own), past)


def pressed(person: LinearPerson) -> tuple[tuple[slice, float], ...]:
    """Return the states of a client that stand off 0 under a force of 1 N that stands: the hand's acceleration, and F kept."""
    if not person.observes:
        return ()
    return (slice(4, 5), 1.0 / person.assumed_mass_kg), (slice(5, 5 + person.latency_ticks), 1.0)


def kept_waves(person: LinearPerson) -> slice:
    """Return the states of a client of the wave scheme that are v of the last ticks, newest first."""
    _, past = _layout(person)
    return slice(past.stop, past.stop + booked_late(person))


def sent_later(person: LinearPerson) -> float:
    """Return the part of a frame that is sent with the next one: the last state of a client, where it is above 0."""
    return person.split_ticks / person.rates.ticks_per_frame if person.decimator == "boxcar" else 0.0


def booked_late(person: LinearPerson) -> int:
    """Return how many ticks late a displacement enters, with the wave of then; y_est goes with the current wave."""
    return person.latency_ticks if person.encoder == "displacement" else 0


def wave_tick(person: LinearPerson, rates: Rates) -> StateSpace:
    """Return one tick of the wave scheme: input v, output u after the filter (P eq. 12, 16, 32).

    The displacement of a tick is the one that its end shows: that of L ticks before, with v of then.
    """
    b, root = person.impedance_nspm, sqrt(2.0 * person.impedance_nspm)
    loop = close(device_block(person, rates), np.array([[b, 0.0, 0.0]]), np.array([[-root]]))
    read = np.array([(0.0, root, 0.0) if person.encoder == "displacement" else (root, 0.0, 0.0)])
    made = StateSpace(loop.A, loop.B, read @ loop.C, read @ loop.D)
    both = diagonal([made, delay(1, booked_late(person))])
    port = through(np.ones((2, 1)), both, np.array([[1.0, -1.0]]))
    return series(port, _filter(person, rates)) if person.decimator == "lowpass" else port


def _filter(person: LinearPerson, rates: Rates) -> StateSpace:
    """Return P eq. 32, discretised exactly; a tick's output contains that tick's input."""
    pole = lowpass_pole(person.lowpass_rad_s, rates)
    return StateSpace(*(np.array([[value]]) for value in (pole, 1.0 - pole, pole, 1.0 - pole)))


def decimator_row(person: LinearPerson, ticks: int) -> Array:
    """Return the weights of a frame's M filtered waves in the one that is sent, shape (M,)."""
    return np.full(ticks, 1.0 / ticks) if person.decimator == "boxcar" else np.eye(ticks)[-1]


def wave_frame(person: LinearPerson, rates: Rates) -> StateSpace:
    """Return one frame of the wave scheme: input v, held over its ticks (P eq. 15); output the wave sent (P eq. 14).

    With a delay of whole frames and p ticks, the frame that is sent has the last p ticks of the frame of v before, and then all
    but the last p of this one. So the output is the part of those, and one frame later that of the others.
    """
    M, p = rates.ticks_per_frame, person.split_ticks
    row = decimator_row(person, M)
    ticks = lift(wave_tick(person, rates), M)
    parts = np.zeros((2, M))
    parts[0, : M - p], parts[1, M - p :] = row[p:], row[:p]
    if not sent_later(person):  # of a lowpass, or none, the last sample of a frame is sent alone
        return through(np.ones((M, 1)), ticks, parts[:1])
    later = StateSpace(np.zeros((1, 1)), np.array([[0.0, 1.0]]), np.ones((1, 1)), np.array([[1.0, 0.0]]))
    return series(through(np.ones((M, 1)), ticks, parts), later)


def wave_filter(person: LinearPerson) -> tuple[StateSpace, ...]:
    """Return the filter on one wave, frame by frame; nothing where there is none. State: its last output."""
    if not person.filter_lag_s:
        return ()
    kept = person.filter_kept
    return (StateSpace(*(np.array([[value]]) for value in (kept, 1.0 - kept, kept, 1.0 - kept))),)


def coupled_tick(person: LinearPerson, stiffness: Array, rates: Rates) -> StateSpace:
    """Return one tick of virtual coupling: inputs x_o, v_o; outputs x as read, y_est. `stiffness` is K, (...)."""
    device = device_block(person, rates)
    speed, place = device.C[0:1], device.C[2:3]
    K, B = stiffness[..., None, None], person.damping_nspm
    own = K * place + B * speed  # F = K (x - x_o) + B (y_est - v_o): what the states make of it ...
    drive = np.empty((*stiffness.shape, 1, 2))  # ... and the inputs
    drive[..., 0] = -K[..., 0]
    drive[..., 1] = -B
    return StateSpace(device.A + device.B @ own, device.B @ drive, np.concatenate((place, speed)), np.zeros((2, 2)))


def coupled_frame(person: LinearPerson, stiffness: Array, rates: Rates) -> StateSpace:
    """Return one frame of virtual coupling: inputs x_o, v_o as of its start, held; outputs x, y_est as of its start."""
    tick = coupled_tick(person, stiffness, rates)
    n = tick.states
    held = np.zeros((*stiffness.shape, n + 2, n + 2))  # M ticks with inputs that stay: the power of [A B; 0 I]
    held[..., :n, :n], held[..., :n, n:] = tick.A, tick.B
    held[..., n:, n:] = np.eye(2)
    frame = np.linalg.matrix_power(held, rates.ticks_per_frame)
    return StateSpace(frame[..., :n, :n], frame[..., :n, n:], tick.C, tick.D)
