"""A person whose server was started anew: one account over all lines."""

from random import Random

import pytest
from msgspec.structs import replace

from cogrip.client.coupling import Coupling
from cogrip.client.energy_ledger import EnergyLedger
from cogrip.client.inputs import CloseLedger
from cogrip.client.virtual_coupling import VirtualCoupling
from cogrip.client.wave_coupling import WaveCoupling
from cogrip.protocol.accounts import PlayoutAccount, TickCount
from cogrip.protocol.line.sender import LineSender
from cogrip.protocol.messages import Stamp, Waves
from cogrip.protocol.rates import due_ns
from cogrip.protocol.settings import SeatSettings, resolve, seat_settings

from tests.client.seated_client import DEVICE_HZ, Client, M


def seat(frames: int | str, kind: str = "wave") -> SeatSettings:
    table = {"coupling": {"kind": kind}, "playout": {"frames": frames}, "users": [{"name": "anna"}]}
    return seat_settings(resolve(table), 0)


def line(settings: SeatSettings, frames: int, loss: float, seed: int, jitter: int = 0) -> WaveCoupling:
    """A line on which so many frames were sent; each datagram is late by up to `jitter` frames."""
    coupling, sender, random = WaveCoupling(settings), LineSender(1, 1), Random(seed)
    flight: list[tuple[int, Waves]] = []
    for number in range(frames):
        sender.push((0.1,))
        first, waves, total, squares = sender.contents()
        message = Waves(7, first, waves, total, squares, 0.0, 0.0, 0, Stamp(1), (0.0, 0.0))
        if random.random() >= loss or number == frames - 1:
            flight.append((number + (random.randint(0, jitter) if number < frames - 1 else 0), message))
        for _, come in sorted((one for one in flight if one[0] <= number), key=lambda one: one[1].first):
            assert coupling.receive(come)
        flight = [one for one in flight if one[0] > number]
        coupling.start_frame()
    return coupling


def account(coupling: WaveCoupling) -> PlayoutAccount:
    found = coupling.playout_account()
    assert found is not None
    return found


def ledger(*lines: Coupling) -> EnergyLedger:
    """Return the ledger of a person who had these lines, one after the other."""
    found = EnergyLedger(lines[0])
    for each in lines[1:]:
        found.begin_line(each)
    return found


@pytest.mark.parametrize("frames", [3, "auto"])
def test_accounts_of_all_lines_are_added_up(frames: int | str) -> None:
    settings = seat(frames)
    lines = [line(settings, 900, 0.3, 1, jitter=6), line(settings, 300, 0.0, 2), line(settings, 600, 0.1, 3, jitter=2)]
    found, accounts, sent = ledger(*lines).playout_account(), [account(each) for each in lines], [900, 300, 600]
    assert [each.count().sent for each in lines] == pytest.approx(sent, abs=8)
    assert found is not None
    weights = [each.count().sent for each in lines]
    mean = sum(one.depth_frames * weight for one, weight in zip(accounts, weights, strict=True)) / sum(weights)
    assert found.depth_frames == pytest.approx(mean, rel=1e-12)
    assert found.least_frames == min(one.least_frames for one in accounts)
    assert found.most_frames == max(one.most_frames for one in accounts)
    assert found.longest_gap == max(one.longest_gap for one in accounts) > 1
    for name in ("repeated", "skipped", "concealed"):
        assert getattr(found, name) == sum(getattr(one, name) for one in accounts), name
    assert found.concealed > account(lines[-1]).concealed, "more than the last line's"
    if frames == "auto":
        assert found.most_frames > accounts[-1].most_frames or found.least_frames < accounts[-1].least_frames


@pytest.mark.parametrize("first", [True, False])
def test_a_line_that_never_began_says_nothing_of_depths(first: bool) -> None:
    settings = seat("auto")
    never, real = WaveCoupling(settings), line(settings, 500, 0.2, 4, jitter=5)
    lines = (never, real) if first else (real, never)
    found, expected = ledger(*lines).playout_account(), account(real)
    assert found is not None
    assert found.depth_frames == pytest.approx(expected.depth_frames, rel=1e-12)
    assert replace(found, depth_frames=0.0) == replace(expected, depth_frames=0.0)


def test_without_waves_there_is_none() -> None:
    settings = seat(0, "coupling")
    assert ledger(VirtualCoupling(settings), VirtualCoupling(settings)).playout_account() is None


def test_the_account_of_a_person_is_over_all_lines() -> None:
    client = Client()
    for number in range(1024):
        now_ns = due_ns(0, number, DEVICE_HZ)
        if number % M == 0:
            client.hear(now_ns, 0.2, lost=200 < number < 400)
        client.tick(number, 0.0)
    before = client.core.handle(CloseLedger(TickCount()), client.core.now_ns).playout
    assert before is not None
    assert before.concealed > 20
    client.core.session.state = "resuming"
    client.renew(due_ns(0, 1024, DEVICE_HZ))
    assert client.core.handle(CloseLedger(TickCount()), client.core.now_ns).playout == before
    for number in range(1024, 1200):
        if number % M == 0:
            client.hear(due_ns(0, number, DEVICE_HZ), 0.2)
        client.tick(number, 0.0)
    after = client.core.handle(CloseLedger(TickCount()), client.core.now_ns).playout
    assert after is not None
    assert (after.concealed, after.longest_gap) == (before.concealed, before.longest_gap)
