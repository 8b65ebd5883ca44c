"""The `web:` device: what a pointer in a browser can do to it, whatever it sends. Virtual time."""

import socket
import struct
from collections.abc import Iterator
from contextlib import suppress
from itertools import pairwise
from math import dist, hypot, inf, nan

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cogrip.devices import DeviceError, make
from cogrip.devices.family.web import public
from cogrip.devices.io.pointer_socket import PointerSocket
from cogrip.devices.web.hand import BURST_S, RELEASE_S, SILENCE_S, SPEED_MPS, STRETCH_N, PointerSettings
from cogrip.devices.web.messages import FrameError, Pointer, decode_own_hand, decode_pointer, encode_pointer
from cogrip.devices.web.web_device import WebDevice, WebSettings

from tests.devices.held_device import RATE_HZ, hold

JUMPS = 7  # ticks from one message to the next at 144 Hz
pointers = st.lists(
    st.tuples(st.integers(1, 200), st.booleans(), st.tuples(*[st.floats(-10.0, 10.0)] * 3)), min_size=1, max_size=20
)


def opened(axes: int = 1, query: str = "") -> WebDevice:
    device = make(f"web:idle{query}", axes=axes)
    assert isinstance(device, WebDevice)
    device.open(RATE_HZ)
    return device


def run(device: WebDevice, tick: int, ticks: int, load_n: float = 0.0) -> int:
    """Run so many ticks under a load; return the next tick."""
    hold(device, range(tick, tick + ticks), (load_n,) * device.capability.axes)
    return tick + ticks


@settings(max_examples=60)
@given(pointers, st.integers(1, 3), st.floats(-8.0, 8.0), st.sampled_from([0.05, 1.0, 10.0]))
def test_any_pointer_is_bounded_in_power_speed_and_stretch(
    stream: list[tuple[int, bool, tuple[float, float, float]]], axes: int, load_n: float, power_w: float
) -> None:
    device = opened(axes, f"?power_w={power_w}")
    hand, tick = device.pointer, 0
    stretch_m = STRETCH_N / hand.stiffness_npm
    for wait, holds, target in stream:
        hand.point(tick, target, holds=holds)
        for _ in range(wait):
            before, held = list(hand.set_point_m), hand.holds
            at = device.position_m
            hand.drive(tick)
            if held and hand.holds:
                assert dist(hand.set_point_m, at) <= stretch_m * (1.0 + 1e-9)
                if dist(before, at) <= stretch_m:
                    assert dist(hand.set_point_m, before) <= SPEED_MPS / RATE_HZ * (1.0 + 1e-9)
            tick = run(device, tick, 1, load_n)
            assert hand.entered_j <= power_w * (tick / RATE_HZ + BURST_S) + 1e-12
    # a hand that pulls with all its might, a load, and what is left of it when the direction turns
    assert hypot(*device.velocity_mps) < device.capability.speed_mps


@settings(max_examples=30)
@given(pointers, st.integers(1, 3))
def test_the_hand_does_no_more_work_than_its_set_point_was_given(
    stream: list[tuple[int, bool, tuple[float, float, float]]], axes: int
) -> None:
    """Energy of the device, and that which its damper takes, has come through the set-point."""
    device, tick = opened(axes), 0
    for wait, holds, target in stream:
        device.pointer.point(tick, target, holds=holds)
        for _ in range(wait):
            tick = run(device, tick, 1)
            kinetic_j = 0.5 * device.capability.apparent_mass_kg * sum(v * v for v in device.velocity_mps)
            assert kinetic_j <= device.pointer.entered_j + 1e-9


def test_a_jump_moves_the_device_to_the_pointer() -> None:
    device = opened(3)
    tick = 0
    while tick < RATE_HZ:
        device.pointer.point(tick, (0.05, -0.03, 0.02), holds=True)
        tick = run(device, tick, JUMPS)
    assert device.position_m == pytest.approx((0.05, -0.03, 0.02), abs=1e-4)


@pytest.mark.parametrize("how", ["releases", "falls silent", "is gone"])
def test_a_pointer_that_ends_lets_go(how: str) -> None:
    device = opened()
    device.pointer.point(0, (0.2,), holds=True)
    tick = run(device, 0, 90, load_n=1.0)
    assert abs(device.pointer.force_n()[0]) > 1.0
    if how == "releases":
        device.pointer.point(tick, (0.0,), holds=False)
    elif how == "is gone":
        device.pointer.let_go()
    within_s = RELEASE_S + (SILENCE_S if how == "falls silent" else 0.0)
    forces = []
    for _ in range(round(within_s * RATE_HZ) + 2):
        tick = run(device, tick, 1, load_n=1.0)
        forces.append(device.pointer.force_n()[0])
    assert forces[-1] == 0.0
    assert not device.pointer.holds
    assert max(abs(a - b) for a, b in pairwise(forces)) < 0.25, "without a jolt"
    run(device, tick, RATE_HZ)
    assert device.pointer.force_n() == [0.0]


@settings(max_examples=40)
@given(st.integers(0, 60), st.floats(-0.2, 0.2), st.floats(-4.0, 4.0))
def test_to_take_hold_again_is_no_jolt(wait: int, target_m: float, load_n: float) -> None:
    device = opened()
    device.pointer.point(0, (0.2,), holds=True)
    tick = run(device, 0, 100, load_n)
    device.pointer.point(tick, (0.0,), holds=False)
    tick = run(device, tick, wait, load_n)
    before_n = device.pointer.force_n()[0]
    device.pointer.point(tick, (target_m,), holds=True)
    assert device.pointer.force_n()[0] == pytest.approx(before_n, abs=1e-9)
    run(device, tick, 1, load_n)
    device.read(tick + 1)
    assert abs(device.pointer.force_n()[0] - before_n) < 0.6


def test_what_is_asked_twice_in_a_tick_moves_nothing() -> None:
    device = opened()
    device.pointer.point(0, (0.1,), holds=True)
    run(device, 0, 20)
    assert device.pointer.drive(20) == device.pointer.drive(20)


# The link ------------------------------------------------------------------------------------------------------------


Linked = tuple[WebDevice, socket.socket]


@pytest.fixture(
    params=[socket.SOCK_DGRAM, getattr(socket, "SOCK_SEQPACKET", socket.SOCK_DGRAM)], ids=["datagrams", "packets"]
)
def linked(request: pytest.FixtureRequest) -> Iterator[Linked]:
    """A device and the page's end of its link."""
    ours, page = socket.socketpair(socket.AF_UNIX, request.param)
    page.settimeout(5.0)
    link = PointerSocket(ours.detach(), "web:pointer")
    device = WebDevice(WebSettings(), PointerSettings(), 1, link)
    device.open(RATE_HZ)
    yield device, page
    link.close()
    page.close()


@pytest.mark.parametrize("bad", [nan, inf, -inf, 1e300, 10.1])
@pytest.mark.parametrize("axis", range(3))
def test_targets_that_are_none_are_refused_and_counted(bad: float, axis: int, linked: Linked) -> None:
    target = [0.01] * 3
    target[axis] = bad
    device, page = linked
    page.send(struct.pack("<BBHI3d", 2, 1, 0, 1, *target))
    device.read(0)
    assert device.counts == {"malformed pointer message": 1}
    assert not device.pointer.holds


@given(st.binary(max_size=80))
def test_any_bytes_are_a_pointer_or_a_frame_error(data: bytes) -> None:
    with suppress(FrameError):
        assert encode_pointer(decode_pointer(data))[:8] == data[:8]


def test_numbers_that_go_back_are_refused_while_it_holds(linked: Linked) -> None:
    device, page = linked
    for number in (5, 5, 4):
        page.send(encode_pointer(Pointer(number, True, (0.01, 0.0, 0.0))))
    device.read(0)
    assert device.counts == {"late pointer message": 2}
    page.send(encode_pointer(Pointer(6, False, (0.0, 0.0, 0.0))))
    page.send(encode_pointer(Pointer(1, True, (0.0, 0.0, 0.0))))  # another tab
    device.read(1)
    assert device.pointer.holds
    assert device.counts == {"late pointer message": 2}


def test_the_page_is_told_of_its_hand(linked: Linked) -> None:
    device, page = linked
    page.send(encode_pointer(Pointer(7, True, (0.05, 0.0, 0.0))))
    hold(device, 33)
    told = [decode_own_hand(page.recv(4096)) for _ in range(3)]
    assert [each.taken for each in told] == [7] * 3
    assert told[-1].state == "live"
    assert told[-1].position_m == (*device.position_m, 0.0, 0.0)
    assert told[-1].force_n[0] < 0.0, "it is pulled forward, and feels that as a force back"
    assert told[-1].limit_n == STRETCH_N < device.capability.peak_force_n


def test_a_page_that_is_gone_lets_go(linked: Linked) -> None:
    """At once, where the socket tells that it is closed; else after the silence."""
    device, page = linked
    page.send(encode_pointer(Pointer(1, True, (0.05, 0.0, 0.0))))
    tick = run(device, 0, 20)
    tells = page.type != socket.SOCK_DGRAM
    page.close()
    run(device, tick, round((RELEASE_S + (0.0 if tells else SILENCE_S)) * RATE_HZ) + 2)
    assert not device.pointer.holds
    assert device.pointer.force_n() == [0.0]
    assert device.counts == ({"page gone: let go": 1} if tells else {})


# The address ---------------------------------------------------------------------------------------------------------


def test_the_link_is_not_shown() -> None:
    assert public("web:pointer?fd=7") == "web:pointer"
    assert public("web:pointer?power_w=2&fd=7") == "web:pointer?power_w=2"
    for address in ("web:pointer", "sim:phantom?hand=csv:fd=7"):
        assert public(address) == address


@pytest.mark.parametrize(
    ("address", "said"),
    [
        ("web:mouse", "unknown web device .mouse."),
        ("web:", "unknown web device"),
        ("web:pointer?power=3&fd=99", "unknown key 'power'; did you mean 'power_w'"),
        ("web:pointer?hand=reach", "unknown key 'hand'"),
        ("web:pointer?power_w=0", "power_w: expects a number of at least"),
        ("web:pointer?fd=99999", "is no socket"),
    ],
)
def test_an_error_names_the_cure_and_not_the_link(address: str, said: str) -> None:
    with pytest.raises(DeviceError, match=said) as caught:
        make(address)
    assert "&fd=" not in str(caught.value)


def test_a_page_s_buttons_come_in_samples_and_are_released_with_it(linked: Linked) -> None:
    device, page = linked
    held = []
    for tick in range(400):
        if tick in (10, 60, 110):
            page.send(encode_pointer(Pointer(tick, tick == 60, (0.0, 0.0, 0.0), 0x8001 if tick > 20 else 0x0010)))
        held.append(device.read(tick).buttons)
        device.write((0.0,))
    assert device.capability.buttons == 16
    assert held[9:11] == [0, 0x10]
    assert held[60:112] == [0x8001] * 52
    silent = round(0.1 * 1024)
    assert held[110 + silent], "one comes every 50 ms"
    assert held[110 + silent + 1] == 0, "silence"
