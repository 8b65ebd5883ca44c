"""The port of partners' models: intentions go on to the others, and what a hand says that it donates is bounded."""

from math import pi

import numpy as np
import pytest

from cogrip.protocol.settings.room import resolve, seat_settings
from cogrip.protocol.wire.clock import MessageClock
from cogrip.protocol.wire.messages import Intent, Partner, Stamp, decode
from cogrip.server.ports.partner_port import DonationLimiter, PartnerPort
from cogrip.server.ports.seat_limits import BURST_S, SeatLimits
from cogrip.server.worlds.partners import PartnersWorld

FRAME_S = 1.0 / 128.0


def test_a_hand_that_claims_any_donation_passes_its_power_alone() -> None:
    limiter = DonationLimiter(FRAME_S, SeatLimits(power_w=10.0))
    told = [limiter.limit(1e6 * step) for step in range(1280)]
    assert told == sorted(told)
    early, late = told[128], told[-1]
    assert late - early == pytest.approx(10.0 * 1151 * FRAME_S, rel=1e-9)
    assert limiter.counts["power limited"] > 1000


def test_an_honest_hand_is_passed_whole_and_from_where_it_began() -> None:
    limiter = DonationLimiter(FRAME_S, SeatLimits(power_w=10.0))
    limiter.limit(5.0)  # of a session before
    for step in range(200):
        limiter.limit(5.0 + 0.01 * step)
    assert limiter.passed_j == pytest.approx(1.99)
    limiter.limit(1.0)  # an older message
    assert limiter.passed_j == pytest.approx(1.99)


def test_the_server_counts_what_it_passed_up_and_to_each() -> None:
    """Three people: each gets half of what another gave; what the limit kept back stays in the reserve of the line up."""
    settings = resolve({
        "coupling": {"kind": "partner"}, "object": {"axes": 1}, "users": [{"name": "a"}, {"name": "b"}, {"name": "c"}],
    })  # fmt: skip
    seats = [seat_settings(settings, number) for number in range(3)]
    world, ports = PartnersWorld(seats), [PartnerPort(seat, SeatLimits(power_w=16.0)) for seat in seats]
    for number in range(3):
        world.join(number, np.zeros(1))
    for step in range(3):
        for number, port in enumerate(ports):
            given = (0.0, 0.25, 1e3)[step] if number == 1 else 0.0
            intent = Intent(number, 7_000_000_000 + step, (0.0,), (0.0,), 150.0, given)
            assert port.receive(Partner(1, step, (0.0,), (0.0,), (intent,), 0, Stamp(1), port_j=-given), 0)
        for port, answer in zip(ports, world.advance([port.pop(1) for port in ports]), strict=True):
            port.push(tuple(answer))
            port.message(1, MessageClock(), 0, (0.0,) * 2, 0.0)
        if step == 1:
            assert [port.used_j for port in ports] == [0.0, 0.25, 0.0]
            assert [port.made_j for port in ports] == [0.125, 0.0, 0.125]
            assert ports[1].up_reserve.now_j == 0.0
            assert ports[1].port_in_j() == -0.25
    assert ports[1].used_j == 16.0 * (BURST_S + FRAME_S)
    assert ports[1].up_reserve.now_j == 1e3 - ports[1].used_j
    assert ports[0].made_j == ports[1].used_j / 2.0


def test_an_intention_goes_to_the_others_in_their_frames_and_stamped_as_it_came() -> None:
    settings = resolve({
        "coupling": {"kind": "partner"}, "object": {"axes": 2}, "users": [{"name": "a"}, {"name": "b"}, {"name": "c"}],
    })  # fmt: skip
    seats = [seat_settings(settings, number) for number in range(3)]
    world, ports = PartnersWorld(seats), [PartnerPort(seat, SeatLimits()) for seat in seats]
    hands = (0.5, 0.5), (0.1, -0.2)
    for number, place in enumerate(hands):
        intent = Intent(number, 7_000_000_000, place, (0.25, 0.0), 150.0, 0.0)
        assert ports[number].receive(Partner(1, 0, place, (0.0, 0.0), (intent,), 0, Stamp(1)), 0)
        world.join(number, np.array(place))
    rows = [port.pop(1) for port in ports[:2]] + [(0.0,) * 12]
    answers = world.advance(rows)
    ports[0].push(tuple(answers[0]))
    told = decode(ports[0].message(1, MessageClock(), 0, (0.0,) * 4, 0.0))
    assert isinstance(told, Partner)
    (only,) = told.intents
    assert (only.seat, only.made_ns, only.stiffness_npm) == (1, 7_000_000_000, 150.0)
    assert only.intention_m == pytest.approx(
        hands[0]
    )  # b is at rest where it took hold: at a's own place, in a's frame
    assert only.rate_mps == (0.25, 0.0)
    assert told.position_m == pytest.approx(hands[0], abs=1e-3)


def test_a_pose_goes_on_by_its_rates_round_the_circle() -> None:
    """An intention on six axes, 50 ms old: its rotation goes on as a rotation, also over half a turn."""
    settings = resolve({
        "coupling": {"kind": "partner"}, "object": {"kind": "scene", "file": "x.xml", "axes": 6},
        "users": [{"name": "a"}, {"name": "b"}],
    })  # fmt: skip
    port = PartnerPort(seat_settings(settings, 0), SeatLimits())
    still, turned, spin = (0.0,) * 6, pi - 0.05, 2.0
    made_ns = 7_000_000_000
    intent = Intent(0, made_ns, (0.1, 0.0, 0.0, 0.0, 0.0, turned), (0.2, 0.0, 0.0, 0.0, 0.0, spin), 150.0, 0.0)
    assert port.receive(Partner(1, 0, still, still, (intent,), 0, Stamp(1)), 0)
    port.next_step_ns = made_ns + 50_000_000 + round(1e9 * FRAME_S)
    row = port.pop(1)
    assert len(row) == 6 * 6
    assert row[:6] == pytest.approx((0.11, 0.0, 0.0, 0.0, 0.0, turned + 0.05 * spin - 2.0 * pi))
    assert row[6:12] == intent.intention_m
    assert not port.receive(Partner(1, 1, (0.0,) * 3, (0.0,) * 3, (), 0, Stamp(1)), 0), "a hand that does not turn"
