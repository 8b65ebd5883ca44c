"""Wave transformation between power variables and wave variables, power-consistent form.

Symbols, per axis (theory section 1; P eq. 12-18 with its slips mended):

    b     wave impedance              [N s/m]
    F     force at a port             [N]
    xdot  velocity at a port          [m/s]     positive: power flows into the line
    u     forward wave, client to server        [sqrt(W)]
    v     returning wave, server to client      [sqrt(W)]

    u = (b xdot + F) / sqrt(2b)       v = (b xdot - F) / sqrt(2b)       F xdot = (u^2 - v^2) / 2

Every function takes floats or numpy arrays of one shape and returns the same.
"""

from math import sqrt


def device_force(b: float, velocity: float, returning: float) -> float:
    """Force on the device's port [N] from its velocity and the wave that came back (P eq. 16)."""
    return b * velocity - sqrt(2.0 * b) * returning


def device_wave(b: float, velocity: float, returning: float) -> float:
    """Forward wave [sqrt(W)] that the device's port sends (P eq. 12)."""
    return sqrt(2.0 * b) * velocity - returning


def proxy_velocity(b: float, forward: float, force: float) -> float:
    """Velocity [m/s] of the user's proxy at the server from the wave that arrived and the server's force.

    P eq. 17 prints 2/sqrt(b) for the first factor; sqrt(2/b) is what its own eq. 12 and 16 imply.
    """
    return sqrt(2.0 / b) * forward - force / b


def server_wave(b: float, forward: float, force: float) -> float:
    """Returning wave [sqrt(W)] that the server's port sends.

    P eq. 13 prints F/sqrt(2b); with it a steady contact returns no force. The factor 2 restores the power identity.
    """
    return forward - sqrt(2.0 / b) * force


def port_power(forward: float, returning: float) -> float:
    """Power [W] that flows into the line at a port: (u^2 - v^2) / 2."""
    return 0.5 * (forward * forward - returning * returning)
