"""The wave transformation: the power identity, both ends of an ideal line, and what the paper prints instead."""

from collections.abc import Callable
from math import isclose, sqrt

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cogrip.protocol.laws import waves
from cogrip.protocol.laws.waves import device_gain, server_gain, wave_of

impedances = st.floats(0.1, 1e3)
velocities = st.floats(-10.0, 10.0)
forces = st.floats(-100.0, 100.0)
wave_values = st.floats(-100.0, 100.0)

Law = Callable[[float, float, float], float]
TINY = 1e-300  # below it squares lose digits


def port_power(forward: float, returning: float) -> float:
    """(u^2 - v^2) / 2."""
    return 0.5 * (forward * forward - returning * returning)


def device_force(b: float, velocity: float, returning: float) -> float:
    return waves.device_force(b, device_gain(b), velocity, returning)


def device_wave(b: float, velocity: float, returning: float) -> float:
    return waves.device_wave(device_gain(b), velocity, returning)


def proxy_velocity(b: float, forward: float, force: float) -> float:
    return waves.proxy_velocity(b, server_gain(b), forward, force)


def server_wave(b: float, forward: float, force: float) -> float:
    return waves.server_wave(server_gain(b), forward, force)


def printed_server_wave(b: float, forward: float, force: float) -> float:
    """P eq. 13 as printed."""
    return forward - force / sqrt(2.0 * b)


def printed_proxy_velocity(b: float, forward: float, force: float) -> float:
    """P eq. 17 as printed."""
    return 2.0 / sqrt(b) * forward - force / b


@given(impedances, velocities, forces, wave_values)
def test_power_at_both_ends_is_what_the_waves_carry(b: float, velocity: float, force: float, came: float) -> None:
    forward, returning = device_wave(b, velocity, came), server_wave(b, came, force)
    for u, v, power in (
        (forward, came, device_force(b, velocity, came) * velocity),
        (came, returning, force * proxy_velocity(b, came, force)),
    ):
        assert isclose(port_power(u, v), power, rel_tol=1e-12, abs_tol=1e-12 * (u**2 + v**2) + TINY)


@given(impedances, velocities, forces)
def test_an_ideal_line_passes_velocity_and_force(b: float, velocity: float, force: float) -> None:
    """Both ends agree on u and v: the proxy moves as the hand does, the hand feels the server's force."""
    forward = wave_of(b, velocity, force)
    returning = server_wave(b, forward, force)
    scale = 1e-12 * (b * abs(velocity) + abs(force)) + TINY
    assert isclose(proxy_velocity(b, forward, force), velocity, abs_tol=scale / b)
    assert isclose(device_force(b, velocity, returning), force, abs_tol=scale)
    assert isclose(device_wave(b, velocity, returning), forward, abs_tol=scale / sqrt(b))


@pytest.mark.parametrize("wave", [server_wave, printed_server_wave])
@pytest.mark.parametrize("velocity", [proxy_velocity, printed_proxy_velocity])
def test_only_the_consistent_equations_keep_the_power_identity(wave: Law, velocity: Law) -> None:
    b, forward, force = 20.0, 0.7, 1.9
    missing = port_power(forward, wave(b, forward, force)) - force * velocity(b, forward, force)
    assert (abs(missing) < 1e-12) == ((wave, velocity) == (server_wave, proxy_velocity))


def held_force(wave: Law, velocity: Law) -> list[float]:
    """Device force [N] while a hand moves 10 mm into a 1000 N/m wall in 0.1 s and then holds still for 0.9 s."""
    b, K, T = 20.0, 1000.0, 1.0 / 1024.0
    returning = proxy = 0.0
    felt = []
    for tick in range(1024):
        hand_velocity = 0.1 if tick < 102 else 0.0
        felt.append(device_force(b, hand_velocity, returning))
        forward = device_wave(b, hand_velocity, returning)
        proxy += T * velocity(b, forward, K * proxy)
        returning = wave(b, forward, K * proxy)
    return felt


def test_steady_contact_holds_with_the_consistent_equations_and_vanishes_with_the_printed_ones() -> None:
    depth_m = 102 * 0.1 / 1024
    mended = held_force(server_wave, proxy_velocity)
    assert mended[-1] == pytest.approx(1000.0 * depth_m, rel=0.05)
    assert mended[-1] == pytest.approx(mended[-200], rel=1e-6)
    printed = held_force(printed_server_wave, printed_proxy_velocity)
    mean_of_last = sum(printed[-64:]) / 64
    assert abs(mean_of_last) < 0.01
