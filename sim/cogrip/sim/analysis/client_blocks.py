"""The client's end as blocks: device, velocity estimate, force law, encoder, filter and decimator; tick by tick, then lifted.

Symbols, per axis: x, y = x' device position [m] and velocity [m/s], y_est what the force law reads, w = (x_{k+1} -
x_k)/T_c mean velocity of a tick, F force on the device [N], f force of the hand [N], u forward and v returning wave
[sqrt(W)], x_o, v_o the object's last known state, b wave impedance, K, B coupling, T_c tick, M ticks in a frame, L age of
a sample in ticks when it is read.
"""

from __future__ import annotations

from math import exp, sqrt

import numpy as np

from cogrip.devices.simulated.zero_order_hold import discretise
from cogrip.protocol.rates import Rates
from cogrip.sim.analysis.linear_session import Person
from cogrip.sim.analysis.state_space import Array, StateSpace, close, lift, series, through


def device_block(person: Person, rates: Rates) -> StateSpace:
    """Inputs F, f, held over a tick; outputs y_est, w, x, w as it is read, x as it is read (P eq. 9).

    States: x, y; the estimator's two if estimated, else y of the last L ticks, newest first; w of the last L ticks; where a
    sample is L ticks old when it is read. The estimator is `AlphaBeta`, with its states as error of position and velocity: it
    reads displacements alone.
    """
    step = discretise(
        person.device_mass_kg,
        person.device_damping_nspm + person.hand_damping_nspm,
        person.hand_stiffness_npm,
        rates.device_hz,
    )
    L, T = person.latency_ticks, rates.tick_s
    own, ways = _ways(person)
    n = own + 2 + L
    A, B, C, D = np.zeros((n, n)), np.zeros((n, 2)), np.zeros((5, n)), np.zeros((5, 2))
    A[:2, :2] = [[1.0 - step.g * step.stiffness_npm, step.p], [-step.h * step.stiffness_npm, step.q]]
    B[:2] = [[-step.g, step.g], [-step.h, step.h]]
    C[1, :2], D[1] = (A[0, :2] - (1.0, 0.0)) * rates.device_hz, B[0] * rates.device_hz  # w
    C[2, 0] = C[4, 0] = 1.0
    C[4, ways] = -T
    _remember(A, B, ways, C[1], D[1])
    C[3], D[3] = (np.eye(n)[-1], 0.0) if L else (C[1], D[1])
    if person.estimated:
        # error of the prediction at the next sample: T_c (w - y_est) - d, with d the error of the estimated position
        error, driven = T * C[3], T * D[3]
        error[2:4] -= (1.0, T)
        left, gained = -(person.memory**2), (1.0 - person.memory) ** 2 / T
        A[2], B[2] = left * error, left * driven
        A[3], B[3] = gained * error, gained * driven
        A[3, 3] += 1.0
        C[0, 3] = 1.0
    else:
        _remember(A, B, slice(2, 2 + L), np.eye(n)[1], np.zeros(2))
        C[0, 1 + L] = 1.0
    return StateSpace(A, B, C, D)


def _ways(person: Person) -> tuple[int, slice]:
    """How many states there are for y_est, and where w of the last ticks stands."""
    own = 2 if person.estimated else person.latency_ticks
    return own, slice(2 + own, 2 + own + person.latency_ticks)


def _remember(A: Array, B: Array, states: slice, row: Array, driven: Array) -> None:
    """States that hold the last values of a signal, newest first."""
    first, end = states.start, states.stop
    if end > first:
        A[first], B[first] = row, driven
        A[first + 1 : end, first : end - 1] = np.eye(end - first - 1)


def gliding(person: Person) -> tuple[slice, ...]:
    """The states of a client that are v while everything moves on at v: y, its estimate, and what is remembered of them."""
    own, ways = _ways(person)
    return (slice(1, 2), slice(3, 4), ways) if person.estimated else (slice(1, 2 + own), ways)


def wave_tick(person: Person, rates: Rates) -> StateSpace:
    """One tick of the wave scheme: inputs v, f; outputs u after the filter, F, x (P eq. 12, 16, 32).

    What is booked of a tick is the displacement that its end shows: that of L ticks before.
    """
    b, root = person.impedance_nspm, sqrt(2.0 * person.impedance_nspm)
    force = np.array([[b, 0.0, 0.0, 0.0, 0.0], [0.0] * 5])
    loop = close(device_block(person, rates), force, np.array([[-root, 0.0], [0.0, 1.0]]))
    speed = (0.0, 0.0, 0.0, root, 0.0) if person.encoder == "displacement" else (root, 0.0, 0.0, 0.0, 0.0)
    read = np.array([speed, (b, 0.0, 0.0, 0.0, 0.0), (0.0, 0.0, 1.0, 0.0, 0.0)])
    straight = np.array([[-1.0, 0.0], [-root, 0.0], [0.0, 0.0]])
    port = StateSpace(loop.A, loop.B, read @ loop.C, read @ loop.D + straight)
    return series(port, _filter(person, rates)) if person.decimator == "lowpass" else port


def _filter(person: Person, rates: Rates) -> StateSpace:
    """P eq. 32 on the first of three signals, discretised exactly; a tick's output has that tick's input in it."""
    pole = exp(-person.lowpass_rad_s * rates.tick_s)
    C = np.array([[pole], [0.0], [0.0]])
    D = np.diag([1.0 - pole, 1.0, 1.0])
    return StateSpace(np.array([[pole]]), np.array([[1.0 - pole, 0.0, 0.0]]), C, D)


def decimator_row(person: Person, ticks: int) -> Array:
    """Weights of a frame's M filtered waves in the one that is sent, shape (M,)."""
    row = np.zeros(ticks)
    if person.decimator == "boxcar":
        row[:] = 1.0 / ticks
    else:
        row[-1] = 1.0
    return row


def wave_frame(person: Person, rates: Rates) -> StateSpace:
    """One frame of the wave scheme: input v, held over its ticks (P eq. 15); output the wave that is sent (P eq. 14)."""
    M = rates.ticks_per_frame
    tick = wave_tick(person, rates)
    inputs = np.kron(np.ones((M, 1)), np.array([[1.0], [0.0]]))
    outputs = np.kron(decimator_row(person, M), np.array([[1.0, 0.0, 0.0]]))
    return through(inputs, lift(tick, M), outputs)


def pushed_wave_frame(person: Person, rates: Rates) -> StateSpace:
    """The same frame with a hand: inputs v, then f of each tick; outputs the wave sent, then F and x of each tick."""
    M = rates.ticks_per_frame
    inputs = np.zeros((2 * M, 1 + M))
    inputs[0::2, 0] = 1.0
    inputs[1::2, 1:] = np.eye(M)
    outputs = np.zeros((1 + 2 * M, 3 * M))
    outputs[0, 0::3] = decimator_row(person, M)
    outputs[1 : 1 + M, 1::3] = np.eye(M)
    outputs[1 + M :, 2::3] = np.eye(M)
    return through(inputs, lift(wave_tick(person, rates), M), outputs)


def coupled_tick(person: Person, stiffness: Array, rates: Rates) -> StateSpace:
    """One tick of virtual coupling: inputs x_o, v_o, f; outputs x as it is read, y_est, F. `stiffness` is K, (...)."""
    device = device_block(person, rates)
    speed, place, push = device.C[0:1], device.C[4:5], device.B[:, :1]
    K, B = stiffness[..., None, None], person.damping_nspm
    own = K * place + B * speed  # F = K (x - x_o) + B (y_est - v_o): what the states make of it ...
    drive = np.zeros((*stiffness.shape, 1, 3))  # ... and the inputs
    drive[..., 0] = -K[..., 0]
    drive[..., 1] = -B
    inputs = push @ drive
    inputs[..., 2:] += device.B[:, 1:]
    C = np.empty((*stiffness.shape, 3, device.states))
    C[..., 0:1, :], C[..., 1:2, :], C[..., 2:3, :] = place, speed, own
    D = np.zeros((*stiffness.shape, 3, 3))
    D[..., 2:3, :] = drive
    return StateSpace(device.A + push @ own, inputs, C, D)


def coupled_frame(person: Person, stiffness: Array, rates: Rates) -> StateSpace:
    """One frame of virtual coupling: inputs x_o, v_o as of its start, held; outputs x, y_est as of its start."""
    tick = coupled_tick(person, stiffness, rates)
    n = tick.states
    held = np.zeros((*stiffness.shape, n + 2, n + 2))  # M ticks with inputs that stay: the power of [A B; 0 I]
    held[..., :n, :n], held[..., :n, n:] = tick.A, tick.B[..., :2]
    held[..., n:, n:] = np.eye(2)
    frame = np.linalg.matrix_power(held, rates.ticks_per_frame)
    return StateSpace(frame[..., :n, :n], frame[..., :n, n:], tick.C[..., :2, :], tick.D[..., :2, :2])


def pushed_coupled_frame(person: Person, stiffness: Array, rates: Rates) -> StateSpace:
    """The same frame with a hand: inputs x_o, v_o, then f of each tick; outputs x, y_est, then F and x of each tick."""
    M = rates.ticks_per_frame
    inputs = np.zeros((3 * M, 2 + M))
    inputs[0::3, 0] = inputs[1::3, 1] = 1.0
    inputs[2::3, 2:] = np.eye(M)
    outputs = np.zeros((2 + 2 * M, 3 * M))
    outputs[0, 0] = outputs[1, 1] = 1.0
    outputs[2 : 2 + M, 2::3] = np.eye(M)
    outputs[2 + M :, 0::3] = np.eye(M)
    return through(inputs, lift(coupled_tick(person, stiffness, rates), M), outputs)
