"""The page in a real browser, shown a session that runs."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from itertools import count, islice, pairwise, product
from math import nan
from typing import Any

import numpy as np
import pytest

from cogrip.view.frames import NOT_PASSIVE, encode
from cogrip.view.scene import PageScene, SceneEvent, to_json

from tests.extent import long
from tests.view.browser_page import BrowserPage, Open, Show, Shown
from tests.view.page_server import TOKEN, PageServer, serving
from tests.view.pictured import anchor, frame, lost, moving, scene

# At which part of a plot's width each pixel of a colour is.
PLOTTED = """(() => {
    const canvas = document.querySelector("figure[data-quantity=%s] canvas"), colour = parseInt("%s".slice(1), 16);
    const { data } = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
    const near = (at) => [16, 8, 0].every((shift, part) => Math.abs(data[at + part] - (colour >> shift & 255)) < 40);
    const found = [...Array(data.length / 4).keys()].filter((pixel) => data[4 * pixel + 3] > 200 && near(4 * pixel));
    return found.map((pixel) => pixel %% canvas.width / canvas.width);
})()"""


@pytest.fixture(scope="module")
def opened(show_shared: Show) -> Shown:
    """A page of two people, to whose frames each test gives numbers of its own."""
    return show_shared(scene())


@contextmanager
def told(opened: Shown, other: PageScene) -> Iterator[None]:
    """Tell the page of another scene for a while."""
    page, server = opened
    for each in (other, scene()):
        server.send(to_json(each))
        page.until(f"cogrip.scene.axes === {each.axes} && cogrip.scene.people.length === {len(each.people)}")
        if each is other:
            yield


SINGLE = ("rtt_ms", "up_ms", "down_ms", "buffer_up_ms", "buffer_down_ms", "up_reserve_mj", "line_reserve_mj", "loss")
"""Numbers of a person that a frame has in single precision."""


def is_in_contact_colour(colour: np.ndarray) -> bool:
    return bool(colour[0] - colour[2] > 0.15)


def test_object_is_drawn_where_the_state_says(opened: Shown) -> None:
    page, server = opened
    here, there = (0.03, -0.045, 0.02), (-0.05, -0.03, -0.055)
    bare = replace(frame(1, here, contact=True), people=())
    for number, (view, (full, empty)) in enumerate(product("1234", [(here, there), (there, here)]), 10):
        page.tab.keyboard.press(view)
        server.send(encode(replace(bare, number=number, position_m=full)))
        assert page.until_drawn(number)["drawn"]["object"] == list(full)
        picture = page.picture()
        assert is_in_contact_colour(page.pixel(picture, full))
        assert not is_in_contact_colour(page.pixel(picture, empty))
        for axis in range(3):
            corner = [value + 0.018 * (each == axis) for each, value in enumerate(full)]  # inside the box of 40 mm
            assert is_in_contact_colour(page.pixel(picture, corner))
        column, row = page.state(f"cogrip.project({list(full)})")
        assert not is_in_contact_colour(picture[round(row), round(column) - 120]), "it is no larger than it is"


def test_people_are_drawn_in_their_colours_at_device_and_proxy(opened: Shown) -> None:
    page, server = opened
    told = scene()
    sent = frame(20, (0.01, 0.02, -0.03))
    page.tab.keyboard.press("4")
    server.send(encode(sent))
    drawn = page.until_drawn(20)["drawn"]
    picture = page.picture()
    for person, markers, told_of in zip(sent.people, drawn["people"], told.people, strict=True):
        hand = [value + offset for value, offset in zip(person.hand_m, anchor(person.seat, 2), strict=True)]
        assert markers["hand"] == hand
        proxy = [value + offset for value, offset in zip(person.proxy_m, told_of.anchor_m, strict=True)]
        assert markers["proxy"] == proxy
        wanted = np.array([int(told_of.colour[each : each + 2], 16) / 255 for each in (1, 3, 5)])
        found = page.pixel(picture, tuple(hand))
        same_hue = np.dot(found, wanted) / np.linalg.norm(found) / np.linalg.norm(wanted)
        assert same_hue > 0.97, "whatever the light"


def test_buttons_grip_and_handle_of_a_person_are_shown(opened: Shown) -> None:
    page, server = opened
    sent = frame(30)
    turned = (0.5, -0.5, 0.5, 0.5)
    first = replace(sent.people[0], buttons=0x80000005, grip_m=0.0125, orientation=turned)
    server.send(encode(replace(sent, people=(first, sent.people[1]))))
    read = page.until_drawn(30)
    assert read["people"][0]["buttons"] == 0x80000005
    assert read["people"][0]["grip_m"] == pytest.approx(0.0125)
    assert read["people"][0]["orientation"] == list(turned)
    w, x, y, z = turned
    assert [each["handle"] for each in read["drawn"]["people"]] == [[x, y, z, w], None]
    page.until("document.querySelector('article[data-seat=\"0\"]').textContent.includes('1 3 32, 12.5 mm')")
    server.send(encode(frame(31)))
    page.until_drawn(31)
    rows = "[...document.querySelectorAll('article')].map((each) => each.querySelector('dl div:last-child').checkVisibility())"
    assert page.state(rows) == [True, False], "a device that has told of no button has no row for them"


def test_page_reads_what_was_written(opened: Shown) -> None:
    page, server = opened
    turned = {"velocity_mps": (0.1, -1 / 3, 1e-9), "orientation": (0.8, 0.6, 0.0, 0.0)}
    sent = replace(moving(4_000_000_001, people=5), axes=2, **turned)
    with told(opened, scene(5)):
        server.send(encode(sent))
        read = page.until_drawn(sent.number)
    assert (read["axes"], read["time_s"]) == (sent.axes, sent.time_s)
    for name in ("position_m", "velocity_mps", "orientation"):
        assert read[name] == list(getattr(sent, name))
    for person, got in zip(sent.people, read["people"], strict=True):
        for name in ("seat", "state", "lost"):
            assert got[name] == getattr(person, name)
        for name in ("hand_m", "proxy_m", "force_n", "seen_m"):
            assert got[name] == list(getattr(person, name))
        for name in SINGLE:
            assert got[name] == float(np.float32(getattr(person, name)))


def test_ghost_is_what_the_chosen_person_is_shown(opened: Shown) -> None:
    page, server = opened
    sent = frame(30)
    server.send(encode(sent))
    assert page.until_drawn(30)["drawn"]["ghost"] == list(sent.people[0].seen_m)
    page.tab.locator("article", has_text="ben").get_by_text("ghost").click()
    page.until(f"cogrip.frame.drawn.ghost?.[0] === {sent.people[1].seen_m[0]}")
    assert "as ben is shown it" in page.text(".label.ghost")
    page.tab.keyboard.press("g")
    page.until("cogrip.frame.drawn.ghost === null")


def test_a_ghost_in_the_objects_place_is_not_drawn(opened: Shown) -> None:
    """Both in one place would flicker."""
    page, server = opened
    for chosen in ("ben", "anna"):  # so that it is hers, whoever's was shown before
        page.tab.locator("article", has_text=chosen).get_by_text("ghost").click()
    for number, away_m in ((31, 0.0), (32, 0.01)):
        sent = frame(number)
        seen = (sent.position_m[0] + away_m, *sent.position_m[1:])
        server.send(encode(replace(sent, people=tuple(replace(each, seen_m=seen) for each in sent.people))))
        drawn = page.until_drawn(number)["drawn"]
        assert (drawn["ghost"] is not None) == (away_m > 0.0)


@pytest.mark.parametrize(
    ("values", "axis"),
    [((0.0, 0.0), [0.0, 0.05]), ((0.5, 2.5), [0.34, 2.66]), ((0.01, 0.01), [0.0, 0.06]), ((-1.0, 1.0), [-1.16, 1.16])],
)
def test_what_is_never_below_0_has_no_axis_there(opened: Shown, values: tuple[float, float], axis: list[float]) -> None:
    page, _ = opened
    drawn = page.state(f"import('/plots.js').then((plots) => plots.spread(null, {values[0]}, {values[1]}))")
    assert drawn == pytest.approx(axis)


def test_state_line_says_state_delay_and_passivity(opened: Shown) -> None:
    page, server = opened
    malformed = page.state("cogrip.stats.malformed")
    sent = frame(1)
    anna, ben = sent.people
    nans = dict.fromkeys(("rtt_ms", "up_reserve_mj", "line_reserve_mj"), nan)
    unknown = replace(ben, state="degraded", force_n=(nan, 0.0, 0.0), **nans)
    told = [
        ((replace(anna, rtt_ms=48.2), unknown), ("anna: live, 48 ms, passive", "ben: degraded")),
        ((replace(anna, flags=NOT_PASSIVE), ben), ("anna: live, 40 ms, NOT PASSIVE", "ben: live, 51 ms, passive")),
        (lost(sent, 1).people, ("anna: live, 40 ms, passive", "ben: not here")),
    ]
    numbers = count(40)
    for people, lines in told:
        found: list[str] = []
        for number in islice(numbers, 100):  # as a server does: a page without news for 1.5 s says that instead
            server.send(encode(replace(sent, number=number, people=people)))
            page.until_drawn(number)
            found = page.tab.locator("#people article strong").all_inner_texts()
            if found == list(lines):
                break
        assert found == list(lines)
    assert page.state("cogrip.stats.malformed") == malformed


def test_hidden_and_unknown_things_are_not_drawn(opened: Shown) -> None:
    page, server = opened
    sent = lost(frame(50), 0)
    people = (sent.people[0], replace(sent.people[1], flags=0))
    server.send(encode(replace(sent, people=people)))
    (markers,) = page.until_drawn(50)["drawn"]["people"]
    assert (markers["seat"], markers["hand"]) == (1, None)
    assert markers["proxy"] is not None


def test_malformed_messages_are_counted_and_change_nothing(opened: Shown) -> None:
    page, server = opened
    before, good = page.state("cogrip.stats.malformed"), encode(frame(60))
    for bad in (good[:-1], good[:50], b"", bytes([9]) + good[1:], "{", good[:97] + b"\x63" + good[98:]):
        server.send(bad)
    server.send(good)
    page.until_drawn(60)
    assert page.state("cogrip.stats.malformed") == before + 5, "an unknown kind is another version's, not malformed"


def test_somebody_joins_and_the_camera_stays(opened: Shown) -> None:
    page, server = opened
    with told(opened, scene(1)):
        page.tab.keyboard.press("2")
        before = page.state("cogrip.project([0.05, 0.01, 0])")
        server.send(to_json(SceneEvent(12.5, "joined", "ben", "ben joined")))
        server.send(to_json(scene(2)))
        page.until("cogrip.scene.people.length === 2")
        assert page.state("cogrip.project([0.05, 0.01, 0])") == before
        assert page.tab.locator("#people article").count() == 2
        assert "ben joined" in page.tab.locator("#events").text_content()
        assert page.text("#news") == "ben joined"


@pytest.mark.parametrize(
    ("code", "reason", "words"),
    [
        long(4401, "", "does not know this page's token"),
        (4401, "the seat of 'anna' is taken", "Not admitted: the seat of 'anna' is taken."),
        long(4403, "", "no right"),
        long(4400, "malformed", "Reload"),
        long(4408, "", "trying again"),
    ],
)
def test_refusal_is_told_in_a_sentence(open_page: Open, code: int, reason: str, words: str) -> None:
    with serving(PageServer(to_json(scene()), refuse=code, reason=reason)) as server:
        page = open_page(server.address)
        page.until(f"document.getElementById('status').textContent.includes({words!r})")


def test_page_says_hello_with_its_token_and_comes_back_after_a_break(show: Show) -> None:
    page, server = show(scene())
    assert server.hellos.get() == {"type": "hello", "token": TOKEN, "hand": False}
    server.sockets[-1].close(1011)
    page.until("document.getElementById('status').textContent.includes('trying again')")
    server.wait_for_page()
    page.until("document.getElementById('status').hidden")
    server.send(encode(frame(9)))
    page.until_drawn(9)
    assert not any(TOKEN in each for each in page.requests if not each.startswith(server.address)), "in no request"


def test_scene_of_another_version_is_told(open_page: Open) -> None:
    with serving(PageServer(to_json(scene()).replace('"version":1', '"version":2'))) as server:
        page = open_page(server.address)
        page.until("document.getElementById('status').textContent.startsWith('This page reads version 1')")


def test_broken_policy_is_noticed(chromium: Any) -> None:
    """The other tests rely on this: a page that broke its policy would fail them."""
    with serving(PageServer(to_json(scene()))) as server:
        page = BrowserPage(chromium, server.address)
        with page.tab.expect_event("console", lambda message: message.text.startswith("policy style-src")):
            page.state("document.body.setAttribute('style', 'color: red')")
        assert len(page.errors) == 2, "the browser's own words and those of the watch"
        page.close()


def test_browser_without_webgl_is_told_so(chromium: Any) -> None:
    with serving(PageServer(to_json(scene()))) as server:
        page = BrowserPage(chromium, server.address, script="HTMLCanvasElement.prototype.getContext = () => null")
        page.until("document.getElementById('status').textContent.includes('no WebGL 2')")
        page.close()


def test_keyboard_and_buttons(opened: Shown) -> None:
    page, server = opened
    server.send(encode(frame(70)))
    page.until_drawn(70)
    places = []
    for key, name in (("1", "front"), ("2", "side"), ("3", "top"), ("4", "iso")):
        page.tab.keyboard.press(key)
        places.append(page.state("cogrip.project([0.05, 0.02, 0.01])"))
        page.tab.get_by_role("button", name=name, exact=True).click()
        assert page.state("cogrip.project([0.05, 0.02, 0.01])") == pytest.approx(places[-1])
    assert len({tuple(each) for each in places}) == 4
    page.tab.keyboard.press("y")
    assert page.text("figure[data-quantity=position] figcaption").startswith("Position y [mm]")
    page.tab.keyboard.press("?")
    assert "dark or light" in page.text("#help")
    page.tab.keyboard.press("Escape")
    light = page.picture()[60, 700]
    page.tab.keyboard.press("t")
    dark = page.picture()[60, 700]
    page.tab.keyboard.press("t")
    assert light.mean() > 0.8
    assert dark.mean() < 0.2


@pytest.mark.parametrize(("scheme", "bright"), [long("light", True), ("dark", False)])
def test_page_follows_the_system_in_dark_and_light(show: Show, scheme: str, bright: bool) -> None:
    page, _ = show(scene(), color_scheme=scheme)
    page.until("cogrip.stats !== null")
    assert (page.picture().mean() > 0.5) == bright


def test_phone_shows_picture_controls_and_plots(show: Show) -> None:
    page, server = show(scene(), width=390, height=844, has_touch=True)
    server.send(encode(frame(1)))
    page.until_drawn(1)
    assert page.state("document.documentElement.scrollWidth") <= 390
    for selector in ("#canvas", "[data-view=iso]", "#theme", "#people article", "#plots figure:last-child canvas"):
        box = page.tab.locator(selector).first.bounding_box()
        assert box["x"] >= 0
        assert box["x"] + box["width"] <= 390
        assert box["height"] >= 20
    before = page.state("cogrip.project([0.05, 0, 0])")
    page.tab.mouse.move(300, 300)
    page.tab.mouse.down()
    page.tab.mouse.move(340, 320)
    page.tab.mouse.up()
    assert page.state("cogrip.project([0.05, 0, 0])") != before


def test_plots_have_a_line_for_each_person_and_end_at_the_newest_frame(opened: Shown) -> None:
    page, server = opened
    page.tab.locator("[data-axis='0']").click()  # along the others one force is the other
    for number in range(100, 190):
        server.send(encode(moving(number)))
        if number % 10 == 9:  # of a burst a slow page draws the newest alone, and its plots have no past
            page.until_drawn(number)
    assert page.tab.locator("#plots figure").count() == 6
    for number in range(190, 220):  # the plots take turns, one in a picture
        server.send(encode(moving(number)))
        page.until_drawn(number)
    for told_of in scene().people:
        columns = page.state(PLOTTED % ("force", told_of.colour))
        assert len(columns) > 100, "a line over the window's past"
        assert max(columns) > 0.86, "up to the newest frame, beside which the plot has its margin"


def test_one_axis_offers_one_axis(opened: Shown) -> None:
    page, server = opened
    with told(opened, scene(axes=1)):
        server.send(encode(replace(frame(1, (0.02, 0.0, 0.0)), axes=1)))
        page.until("document.getElementById('object').textContent === 'object x 20.0 mm, 0.100 m/s'")
        assert [each.is_visible() for each in page.tab.locator("[data-axis]").all()] == [True, False, False]
        left, right = [page.state(f"cogrip.project([{x}, 0, 0])") for x in (-0.05, 0.05)]
    assert right[0] - left[0] > 100, "x runs to the right"


def test_what_a_ghost_is_stands_over_no_name(opened: Shown) -> None:
    page, server = opened
    sent = frame(41)
    button = page.tab.locator("article", has_text="anna").get_by_text("ghost")
    if button.get_attribute("aria-pressed") == "false":
        button.click()
    server.send(encode(sent))
    page.until_drawn(41)
    boxes = "[...document.querySelectorAll('.label:not(.axis)')].map((each) => each.getBoundingClientRect().toJSON())"
    *_, ghost = page.state(boxes)
    (_, row), (_, above) = page.state("[cogrip.project([0, 0, 0]), cogrip.project([0, 0, 0.001])]")
    here = (0.0, 0.0, 0.001 * (ghost["top"] + 20 - row) / (above - row))  # her name would stand 20 px above that
    anchor_m = scene().people[0].anchor_m
    moved = replace(sent.people[0], hand_m=tuple(at - held for at, held in zip(here, anchor_m, strict=True)))
    server.send(encode(replace(sent, number=42, people=(moved, sent.people[1]))))
    page.until_drawn(42)
    name, _, ghost = page.state(boxes)
    assert name["left"] < ghost["right"]
    assert name["right"] > ghost["left"]
    assert ghost["top"] >= name["bottom"] or ghost["bottom"] <= name["top"]


def test_names_of_people_in_one_place_stand_below_each_other(opened: Shown) -> None:
    page, server = opened
    sent = frame(40)
    here = sent.people[0]
    anchors = [each.anchor_m for each in scene().people]
    people = tuple(
        replace(each, hand_m=tuple(at - held for at, held in zip(here.hand_m, anchor, strict=True)))
        for each, anchor in zip(sent.people, anchors, strict=True)
    )
    server.send(encode(replace(sent, people=people)))
    page.until_drawn(40)
    boxes = page.state(
        "[...document.querySelectorAll('.label:not(.axis):not(.ghost)')].map((each) => each.getBoundingClientRect().toJSON())"
    )
    assert len(boxes) > 1
    tops = sorted(box["top"] for box in boxes)
    assert all(after - before >= boxes[0]["height"] for before, after in pairwise(tops))


@pytest.mark.parametrize(("value", "text"), [(-0.04, "0.0"), (-0.06, "-0.1"), (0.0, "0.0"), (12.34, "12.3")])
def test_what_is_0_when_rounded_has_no_sign(opened: Shown, value: float, text: str) -> None:
    page, _ = opened
    assert page.state(f"import('/people.js').then((people) => people.fixed({value}, 1))") == text
