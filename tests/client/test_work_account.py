"""A person whose server was started anew: one account over all lines."""

from random import Random

import numpy as np
import pytest
from msgspec.structs import replace

from cogrip.client.coupling.interface import Coupling
from cogrip.client.coupling.virtual_coupling import VirtualCoupling
from cogrip.client.coupling.wave_coupling import WaveCoupling
from cogrip.client.seat.work_account import WorkAccount
from cogrip.protocol.line.sender import LineSender
from cogrip.protocol.settings.seat import SeatSettings
from cogrip.protocol.wire.accounts import PlayoutAccount
from cogrip.protocol.wire.messages import Waves

from tests.client.seated_client import Client, at_ns, next_waves, seat


def line(settings: SeatSettings, frames: int, loss: float, seed: int, jitter: int = 0) -> WaveCoupling:
    """A line on which so many frames were sent; each datagram is late by up to `jitter` frames."""
    coupling, sender, random = WaveCoupling(settings), LineSender(1, 1), Random(seed)
    flight: list[tuple[int, Waves]] = []
    for number in range(frames):
        message, last = next_waves(sender, 0.1), number == frames - 1
        if random.random() >= loss or last:
            flight.append((number + (0 if last else random.randint(0, jitter)), message))
        for _, come in sorted((one for one in flight if one[0] <= number), key=lambda one: one[1].first):
            assert coupling.receive(come)
        flight = [one for one in flight if one[0] > number]
        coupling.start_frame()
    return coupling


def account(coupling: WaveCoupling) -> PlayoutAccount:
    found = coupling.playout_account()
    assert found is not None
    return found


def ledger(*lines: Coupling) -> WorkAccount:
    """Return the ledger of a person who had these lines, one after the other."""
    found = WorkAccount(lines[0])
    for each in lines[1:]:
        found.begin_line(each)
    return found


@pytest.mark.parametrize("frames", [3, "auto"])
def test_accounts_of_all_lines_are_added_up(frames: int | str) -> None:
    settings = seat(playout={"frames": frames})
    lines = [line(settings, 900, 0.3, 1, jitter=6), line(settings, 300, 0.0, 2), line(settings, 600, 0.1, 3, jitter=2)]
    found, accounts = ledger(*lines).playout_account(), [account(each) for each in lines]
    weights = [each.count().sent for each in lines]
    assert weights == pytest.approx([900, 300, 600], abs=8)
    assert found is not None
    mean = np.average([one.depth_frames for one in accounts], weights=weights)
    assert found.depth_frames == pytest.approx(mean, rel=1e-12)
    assert found.least_frames == min(one.least_frames for one in accounts)
    assert found.most_frames == max(one.most_frames for one in accounts)
    assert found.longest_gap == max(one.longest_gap for one in accounts) > 1
    for name in ("repeated", "skipped", "concealed"):
        assert getattr(found, name) == sum(getattr(one, name) for one in accounts), name
    assert found.concealed > accounts[-1].concealed, "more than the last line's"
    if frames == "auto":
        assert found.most_frames > accounts[-1].most_frames or found.least_frames < accounts[-1].least_frames


@pytest.mark.parametrize("order", [1, -1], ids=["first", "last"])
def test_a_line_that_never_began_says_nothing_of_depths(order: int) -> None:
    settings = seat(playout={"frames": "auto"})
    real = line(settings, 500, 0.2, 4, jitter=5)
    found, expected = ledger(*(WaveCoupling(settings), real)[::order]).playout_account(), account(real)
    assert found is not None
    assert found.depth_frames == pytest.approx(expected.depth_frames, rel=1e-12)
    assert replace(found, depth_frames=0.0) == replace(expected, depth_frames=0.0)


def test_without_waves_there_is_none() -> None:
    settings = seat(coupling={"kind": "coupling"})
    assert ledger(VirtualCoupling(settings), VirtualCoupling(settings)).playout_account() is None


def test_the_account_of_a_person_is_over_all_lines() -> None:
    client = Client()
    client.run(range(1024), wave=lambda number: client.hear(at_ns(number), 0.2, lost=200 < number < 400))
    before = client.account().playout
    assert before is not None
    assert before.concealed > 20
    client.core.session.state = "resuming"
    client.renew(at_ns(1024))
    assert client.account().playout == before
    client.hear(at_ns(1024), 0.2)
    client.run(range(1024, 1200), wave=0.2)
    after = client.account().playout
    assert after is not None
    assert (after.concealed, after.longest_gap) == (before.concealed, before.longest_gap)
