"""The client's end as blocks: device, velocity estimate, force law, encoder, filter and decimator; tick by tick, then lifted.

Symbols, per axis: x, y = x' device position [m] and velocity [m/s], y_est what the force law reads, w = (x_{k+1} -
x_k)/T_c mean velocity of a tick, F force on the device [N], f force of the hand [N], u forward and v returning wave
[sqrt(W)], x_o, v_o the object's last known state, b wave impedance, K, B coupling, T_c tick, M ticks in a frame.
"""

from __future__ import annotations

from math import exp, sqrt

import numpy as np

from cogrip.client.velocity import MEMORY
from cogrip.devices.simulated.zero_order_hold import discretise
from cogrip.protocol.rates import Rates
from cogrip.sim.analysis.linear_session import Person
from cogrip.sim.analysis.state_space import Array, StateSpace, close, lift, series, through


def device_block(person: Person, rates: Rates) -> StateSpace:
    """Inputs F, f, held over a tick; outputs y_est, w, x; states x, y and, if estimated, the estimator's two (P eq. 9).

    The estimator is `AlphaBeta`, with its states as error of position and velocity: it reads displacements alone.
    """
    step = discretise(
        person.device_mass_kg,
        person.device_damping_nspm + person.hand_damping_nspm,
        person.hand_stiffness_npm,
        rates.device_hz,
    )
    rate = float(rates.device_hz)
    A = np.array([[1.0 - step.g * step.stiffness_npm, step.p], [-step.h * step.stiffness_npm, step.q]])
    B = np.array([[-step.g, step.g], [-step.h, step.h]])
    moved = (A - np.eye(2))[0] * rate, B[0] * rate  # w
    if not person.estimated:
        C = np.array([[0.0, 1.0], moved[0], [1.0, 0.0]])
        return StateSpace(A, B, C, np.array([[0.0, 0.0], moved[1], [0.0, 0.0]]))
    # error of the prediction at the next sample: T_c (w - y_est) - d, with d the error of the estimated position
    error = np.concatenate((moved[0], (-rate, -1.0))) * rates.tick_s, moved[1] * rates.tick_s
    left, gained = -(MEMORY**2), (1.0 - MEMORY) ** 2 * rate
    large = np.zeros((4, 4))
    large[:2, :2] = A
    large[2] = left * error[0]
    large[3] = gained * error[0]
    large[3, 3] += 1.0
    inputs = np.concatenate((B, [left * error[1]], [gained * error[1]]))
    C = np.array([[0.0, 0.0, 0.0, 1.0], [*moved[0], 0.0, 0.0], [1.0, 0.0, 0.0, 0.0]])
    return StateSpace(large, inputs, C, np.array([[0.0, 0.0], moved[1], [0.0, 0.0]]))


def wave_tick(person: Person, rates: Rates) -> StateSpace:
    """One tick of the wave scheme: inputs v, f; outputs u after the filter, F, x (P eq. 12, 16, 32)."""
    b, root = person.impedance_nspm, sqrt(2.0 * person.impedance_nspm)
    force = np.array([[b, 0.0, 0.0], [0.0, 0.0, 0.0]])
    loop = close(device_block(person, rates), force, np.array([[-root, 0.0], [0.0, 1.0]]))
    speed = (0.0, root, 0.0) if person.encoder == "displacement" else (root, 0.0, 0.0)
    read = np.array([speed, (b, 0.0, 0.0), (0.0, 0.0, 1.0)])
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
    """One tick of virtual coupling: inputs x_o, v_o, f; outputs x, y_est, F. `stiffness` is K, shape (...)."""
    device = device_block(person, rates)
    speed, place, push = device.C[0:1], device.C[2:3], device.B[:, :1]
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
