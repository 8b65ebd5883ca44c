"""The wave transformation between power variables and wave variables, power-consistent form: the only place of its equations.

Symbols, per axis (theory section 1; P eq. 12-18 with its slips corrected):

    b     wave impedance              [N s/m]
    F     force at a port             [N]
    xdot  velocity at a port          [m/s]     positive: power flows into the line
    u     forward wave, client to server        [sqrt(W)]
    v     returning wave, server to client      [sqrt(W)]
    g     sqrt(2b) at the client      [sqrt(N s/m)]: `device_gain`
    c     sqrt(2/b) at the server     [sqrt(m/(N s))]: `server_gain`

    u = (b xdot + F) / sqrt(2b)       v = (b xdot - F) / sqrt(2b)       F xdot = (u^2 - v^2) / 2

Gains are computed once, outside of loops. The others take floats or numpy arrays, b and gains broadcast, and return the same.
A loop in plain floats may repeat an equation inline, with its name beside it, where a call an axis is measured to cost more
than 3 %.
"""

from math import sqrt
from typing import TYPE_CHECKING, TypeVar

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

Value = TypeVar("Value", float, "NDArray[np.float64]")


def device_gain(b: float) -> float:
    """Return g = sqrt(2b) [sqrt(N s/m)]."""
    return sqrt(2.0 * b)


def server_gain(b: float) -> float:
    """Return c = sqrt(2/b) [sqrt(m/(N s))]."""
    return sqrt(2.0 / b)


def wave_of(b: float, velocity: float, force: float) -> float:
    """Return the forward wave [sqrt(W)] of a port's velocity [m/s] and force [N] (P eq. 12)."""
    return (b * velocity + force) / sqrt(2.0 * b)


def device_force(b: Value, gain: Value, velocity: Value, returning: Value) -> Value:
    """Return the force on the device's port [N], F = b xdot - g v (P eq. 16)."""
    return b * velocity - gain * returning


def device_wave(gain: Value, velocity: Value, returning: Value) -> Value:
    """Return the forward wave [sqrt(W)] that the device's port sends, u = g xdot - v (P eq. 12)."""
    return gain * velocity - returning


def proxy_velocity(b: Value, gain: Value, forward: Value, force: Value) -> Value:
    """Return the velocity [m/s] of the user's proxy at the server, xdot = c u - F / b.

    P eq. 17 prints 2/sqrt(b) for c; sqrt(2/b) is what its own eq. 12 and 16 imply.
    """
    return gain * forward - force / b


def server_wave(gain: Value, forward: Value, force: Value) -> Value:
    """Return the wave [sqrt(W)] that the server's port sends back, v = u - c F.

    P eq. 13 prints F/sqrt(2b); with it a steady contact returns no force. The factor 2 restores the power identity.
    """
    return forward - gain * force
