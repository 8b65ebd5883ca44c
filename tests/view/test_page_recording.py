"""The page in a real browser, playing a recording: from a socket, and as one file from a disk."""

from pathlib import Path
from typing import Any

import pytest

from cogrip.view.frames import SceneFrame
from cogrip.view.page import self_contained
from cogrip.view.scene import to_json

from tests.view.browser_page import BrowserPage, Open, Show
from tests.view.page_server import PageServer, serving
from tests.view.pictured import FRAMES_HZ, anchor, recording

SECONDS = 25
TOLD, CHUNKS, FRAMES = recording(SECONDS)


@pytest.fixture(scope="module")
def opened(show_shared: Show) -> BrowserPage:
    return show_shared(TOLD, CHUNKS)[0]


@pytest.fixture
def shared(opened: BrowserPage) -> BrowserPage:
    """The page that all tests look at, as it is when it was opened."""
    opened.until("cogrip.player")
    if opened.state("cogrip.player.playing"):
        opened.tab.keyboard.press(" ")
    if opened.state("cogrip.player.loop.on"):
        opened.tab.keyboard.press("l")
    opened.tab.locator("[data-part=speed]").select_option("1")
    opened.tab.locator("[data-part=speed]").blur()
    seek(opened, 0.0)
    opened.until_drawn(0)
    return opened


def seek(page: BrowserPage, time_s: float) -> None:
    page.state(f"cogrip.seek({time_s!r})")


def assert_drawn_exactly(drawn: dict[str, Any], frame: SceneFrame) -> None:
    """The pose in the picture is that of the recording, to the last bit."""
    assert drawn["time_s"] == frame.time_s
    assert drawn["drawn"]["object"] == list(frame.position_m)
    assert drawn["drawn"]["ghost"] == list(frame.people[0].seen_m)
    for person, markers in zip(frame.people, drawn["drawn"]["people"], strict=True):
        held = anchor(person.seat, len(frame.people))
        assert markers["hand"] == [value + offset for value, offset in zip(person.hand_m, held, strict=True)]
        assert markers["proxy"] == [value + offset for value, offset in zip(person.proxy_m, held, strict=True)]


@pytest.mark.sample(1)
@pytest.mark.parametrize("number", [0, 1, 599, 600, 1199, 1200, 1499])
def test_pose_at_a_frames_time_is_the_recorded_one(shared: BrowserPage, number: int) -> None:
    seek(shared, FRAMES[number].time_s)
    assert_drawn_exactly(shared.until_drawn(number), FRAMES[number])


def test_scrub_bar_shows_the_moment_that_it_is_drawn_to(shared: BrowserPage) -> None:
    box = shared.tab.locator("[data-part=scrub]").bounding_box()
    shared.tab.mouse.click(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    shared.until("cogrip.frame.time_s > 1")
    drawn = shared.state("cogrip.frame")
    assert drawn["time_s"] == pytest.approx(SECONDS / 2, abs=0.2)
    assert_drawn_exactly(drawn, FRAMES[drawn["number"]])


def test_single_frames_forth_and_back_over_the_end_of_a_chunk(shared: BrowserPage) -> None:
    seek(shared, FRAMES[598].time_s)
    shared.until_drawn(598)
    for number in (599, 600, 601):
        shared.tab.keyboard.press(".")
        assert_drawn_exactly(shared.until_drawn(number), FRAMES[number])
    for number in (600, 599):
        shared.tab.keyboard.press(",")
        assert_drawn_exactly(shared.until_drawn(number), FRAMES[number])


def test_plays_draws_what_it_passes_and_pauses(shared: BrowserPage) -> None:
    shared.tab.keyboard.press(" ")
    shared.until("cogrip.frame.time_s > 0.5")
    shared.tab.keyboard.press(" ")
    assert not shared.state("cogrip.player.playing")
    drawn = shared.state("cogrip.frame")
    assert_drawn_exactly(drawn, FRAMES[drawn["number"]])
    shown_s = shared.state("cogrip.player.time_s")
    assert 0 <= shown_s - drawn["time_s"] < 1.5 / FRAMES_HZ


def test_fetches_the_next_chunk_ahead_and_each_once(show: Show) -> None:
    page, server = show(TOLD, CHUNKS)
    page.until_drawn(0)
    assert server.asked == [0, 1]
    for time_s in (12.0, 3.0, 21.0):
        seek(page, time_s)
        page.until_drawn(round(time_s * FRAMES_HZ))
    assert server.asked == [0, 1, 2]


def test_events_are_marked_and_reached_by_keys_and_clicks(shared: BrowserPage) -> None:
    assert shared.tab.locator(".tick").count() == 3
    for key, time_s in (("n", 2.0), ("n", 7.5), ("n", 14.0), ("p", 7.5), ("p", 2.0)):
        shared.tab.keyboard.press(key)
        assert shared.state("cogrip.player.time_s") == time_s
    shared.tab.locator(".tick.lost").click()
    assert shared.state("cogrip.player.time_s") == 14.0
    shared.tab.get_by_text("Events").click()
    shared.tab.locator("#events").get_by_text("marker: grip").click()
    assert shared.state("cogrip.player.time_s") == 7.5


def test_loop_stays_in_its_range(shared: BrowserPage) -> None:
    seek(shared, 7.0)
    shared.tab.keyboard.press("a")
    seek(shared, 7.2)
    shared.tab.keyboard.press("b")
    assert shared.state("cogrip.player.loop") == {"on": True, "from_s": 7.0, "to_s": 7.2}
    shared.tab.keyboard.press(" ")
    for _ in range(2):
        shared.until("cogrip.player.time_s > 7.1")
        shared.until("cogrip.player.time_s < 7.1")
    assert 7.0 <= shared.state("cogrip.player.time_s") <= 7.2
    shared.tab.keyboard.press("l")
    shared.until("cogrip.player.time_s > 7.3")


def test_speed_keys_and_ends(shared: BrowserPage) -> None:
    shared.tab.locator("[data-part=speed]").select_option("10")
    seek(shared, SECONDS - 4.0)
    shared.tab.keyboard.press(" ")
    shared.until(f"cogrip.player.time_s === {SECONDS} && !cogrip.player.playing")
    assert_drawn_exactly(shared.until_drawn(1499), FRAMES[1499])
    for _ in range(9):
        shared.tab.keyboard.press("-")
    assert shared.state("cogrip.player.speed") == 0.1
    for key, time_s in (("ArrowLeft", SECONDS - 1), ("Shift+ArrowLeft", SECONDS - 11), ("Home", 0)):
        shared.tab.keyboard.press(key)
        assert shared.state("cogrip.player.time_s") == time_s


@pytest.mark.long
def test_phone_shows_the_player(show: Show) -> None:
    page, _ = show(TOLD, CHUNKS, width=390, height=844, has_touch=True)
    page.until_drawn(0)
    for name in ("play", "scrub", "loop"):
        box = page.tab.locator(f"[data-part={name}]").bounding_box()
        assert box["x"] >= 0
        assert box["x"] + box["width"] <= 390
        assert box["y"] + box["height"] <= 844
    page.tab.locator("[data-part=play]").tap()
    page.until("cogrip.frame.number > 10")


def test_self_contained_page_plays_from_a_disk_without_a_network(open_page: Open, tmp_path: Path) -> None:
    file = tmp_path / "page.html"
    file.write_text(self_contained(to_json(TOLD), CHUNKS), encoding="utf-8")
    page = open_page(file.as_uri(), offline=True)
    assert_drawn_exactly(page.until_drawn(0), FRAMES[0])
    for number in (700, 1499):
        seek(page, FRAMES[number].time_s)
        assert_drawn_exactly(page.until_drawn(number), FRAMES[number])
    page.tab.keyboard.press("Home")
    page.tab.keyboard.press(" ")
    page.until("cogrip.frame.number > 30")
    asked = [each for each in page.requests if not each.startswith("data:")]
    assert asked == [file.as_uri()]


def test_damaged_chunk_is_told(open_page: Open) -> None:
    with serving(PageServer(to_json(TOLD), [CHUNKS[0][:12] + b"no gzip", *CHUNKS[1:]])) as server:
        page = open_page(server.address)
        page.until("document.getElementById('status').textContent.startsWith('A part of the recording cannot be read')")


def test_names_of_a_recording_cannot_end_its_script() -> None:
    told = to_json(TOLD).replace("ben joined", "</script><script>alert(1)</script><!--")
    text = self_contained(told, CHUNKS)
    assert "alert(1)" in text
    assert "<script>alert" not in text
