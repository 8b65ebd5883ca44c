"""`openhaptics:`: what one frame of the servo reads and sends, by mailbox alone and round by round of the scheduler."""

from collections import Counter
from math import nan

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cogrip.devices.device import DeviceError
from cogrip.devices.openhaptics.mailbox import HOLD_FRAMES, ZERO, Mailbox, to_common, to_library

three = st.tuples(*[st.floats(-5.0, 5.0)] * 3)


def test_each_frame_is_read_once(bench) -> None:
    device = bench.opened()
    assert device.read(0) is None
    bench.step()
    assert device.read(1) is not None
    assert device.read(1) is None
    bench.step(3)
    assert device.read(2) is not None
    with pytest.raises(DeviceError, match="read\\(tick=1\\) after tick 2; ticks must not fall"):
        device.read(1)
    device.close()


def test_a_loop_that_stops_leaves_no_force(bench) -> None:
    device = bench.opened()
    device.write((1.0, 0.0, 0.0))
    bench.step(HOLD_FRAMES)
    assert bench.force() == (0.0, 0.0, -1.0)
    bench.step()
    assert bench.force() == (0.0, 0.0, 0.0)
    assert device.counts == {"force not renewed": 1}
    assert device.read(60) is not None
    device.close()


def test_close_sends_zero_within_a_frame_of_its_own(bench) -> None:
    device = bench.opened()
    device.write((1.0, 0.0, 0.0))
    bench.step()
    frames = bench.lib.stub_frames(0)
    device.close()
    assert bench.force() == (0.0, 0.0, 0.0)
    assert bench.lib.stub_frames(0) == frames + 1


def test_axes_of_the_vectors() -> None:
    assert to_common((10.0, -20.0, 30.0)) == pytest.approx((0.030, 0.010, -0.020))
    assert to_library((1.0, 2.0, 3.0)) == (2.0, 3.0, 1.0)


@given(force=three, step_mm=three)
def test_work_is_the_same_in_both_frames(force, step_mm) -> None:
    """F dx does not depend on how axes are named: force and position are mapped alike."""
    there = sum(f * s for f, s in zip(to_library(force), step_mm, strict=True))
    here = sum(f * s for f, s in zip(force, to_common(step_mm), strict=True))
    assert 1e-3 * there == pytest.approx(here, abs=1e-12)


@given(
    st.lists(
        st.one_of(
            three.map(lambda force: ("say", force)),
            st.sampled_from([("frame", None), ("nan", None), ("skip", None), ("fatal", None), ("drop", None)]),
            st.integers(1, 60).map(lambda many: ("frames", many)),
        ),
        max_size=30,
    )
)
@settings(max_examples=200)
def test_what_is_sent_is_the_newest_force_or_zero(events) -> None:
    """An independent account of the rule: zero when lost, dropped, untrusted, or not renewed for HOLD_FRAMES frames."""
    mailbox = Mailbox(Counter())
    newest, since, drop, lost = ZERO, HOLD_FRAMES, False, False
    for event, argument in events:
        if event == "say":
            newest, since = argument, 0
            mailbox.say(argument)
        elif event == "fatal":
            lost = True
            mailbox.trouble(0x302, "gone")
        elif event == "drop":
            drop = True
            mailbox.trouble(0x201, "")
        else:
            for _ in range(argument or 1):
                good = event in ("frame", "frames") and not drop and not lost and since < HOLD_FRAMES
                sent = (
                    mailbox.skip("why")
                    if event == "skip"
                    else mailbox.frame((nan if event == "nan" else 0.0, 0.0, 0.0))
                )
                assert sent == (to_library(newest) if good else ZERO)
                drop, since = False, since + 1
    assert bool(mailbox.lost) == lost
