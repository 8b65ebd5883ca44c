"""The example clients of `docs/view.md`: they print what was sent, and lead a hand in a circle."""

import math
import re

import pytest

from cogrip.devices.web.messages import OwnHand, Pointer, decode_pointer, encode_own_hand
from cogrip.view.frames import PersonFrame, SceneFrame, encode
from cogrip.view.scene import PageScene, to_json

from tests.view.example_programs import LIMIT_S, example, started
from tests.view.page_server import TOKEN, PageServer, serving
from tests.view.pictured import scene

HALF_OF_THE_LAST_DIGIT_MM = 0.0005 + 1e-9
SEEN = re.compile(r"(-?[\d.]+) s  object (\S+ \S+ \S+)((?:  \w+ \w+ \S+ \S+ \S+ force \S+ N)*)")
PERSON = re.compile(r"(\w+) (\w+) (\S+ \S+ \S+) force (\S+) N")


@pytest.fixture(params=["view_client.py", "view_client.js"])
def command(request: pytest.FixtureRequest) -> list[str]:
    return example(request.param)


def moment(number: int) -> SceneFrame:
    """Return a frame of anna, who holds on, and ben, who is not there any more."""
    here = (0.01 * math.sin(number), -0.02, 0.001 * number)
    anna = PersonFrame(0, "degraded", hand_m=(1 / 3, -0.05, 0.007 * number), force_n=(3.0, 4.0 * number, 0.0))
    return SceneFrame(3, number, 100.0 + number / 64, here, (0.0, 0.0, 0.0), (anna, PersonFrame(1)))


def assert_printed(line: str, frame: SceneFrame, told: PageScene) -> None:
    found = SEEN.fullmatch(line.strip())
    assert found, line
    assert float(found[1]) == pytest.approx(frame.time_s, abs=0.0005001)
    assert_at(found[2], frame.position_m)
    present = [each for each in frame.people if each.state != "free"]
    people = PERSON.findall(found[3])
    assert len(people) == len(present)
    for (name, state, hand, force), person in zip(people, present, strict=True):
        who = told.people[person.seat]
        assert (name, state) == (who.name, person.state)
        assert_at(hand, [value + held for value, held in zip(person.hand_m, who.anchor_m, strict=True)])
        assert float(force) == pytest.approx(math.hypot(*person.force_n), abs=0.0005001)


def assert_at(text: str, position_m) -> None:
    wanted = [pytest.approx(1e3 * value, abs=HALF_OF_THE_LAST_DIGIT_MM) for value in position_m]
    assert [float(each) for each in text.split()] == wanted


def test_client_prints_what_was_sent(command: list[str]) -> None:
    told, frames = scene(), [moment(number) for number in range(5)]
    with serving(PageServer(to_json(told))) as server, started(command, server.address) as client:
        server.wait_for_page()
        assert server.hellos.get() == {"type": "hello", "token": TOKEN, "hand": False}
        for frame in frames:
            server.send(encode(frame))
        server.sockets[-1].close(1001)
        printed, errors = client.communicate(timeout=LIMIT_S)
    *lines, last = (printed + errors).splitlines()
    assert len(lines) == len(frames)
    for line, frame in zip(lines, frames, strict=True):
        assert_printed(line, frame, told)
    assert last == "closed: 1001"


def test_client_says_with_which_code_it_was_refused(command: list[str]) -> None:
    with serving(PageServer("", refuse=4401)) as server, started(command, server.address) as client:
        printed, errors = client.communicate(timeout=LIMIT_S)
    assert (printed + errors).splitlines() == ["closed: 4401"]


def test_hand_goes_in_a_circle_from_where_it_is(command: list[str]) -> None:
    begin_m = (0.02, 0.03, 0.04)
    with serving(PageServer(to_json(scene(hand=True)))) as server, started(command, f"{server.address}&hand", "--hand"):
        server.wait_for_page()
        assert server.hellos.get() == {"type": "hello", "token": TOKEN, "hand": True}
        said: list[Pointer] = []
        while len(said) < 20:
            server.send(encode_own_hand(OwnHand("live", 0, begin_m, (0.0, 0.0, 0.0), 3.0)))
            message = server.said.get(timeout=LIMIT_S)
            assert isinstance(message, bytes)
            said.append(decode_pointer(message))
    assert [each.number for each in said] == list(range(1, 21))
    assert all(each.holds for each in said)
    x, y, z = begin_m
    angles = [math.atan2(each.target_m[1] - y, each.target_m[0] - (x - 0.03)) for each in said]
    for each, angle in zip(said, angles, strict=True):
        on_circle = (x + 0.03 * (math.cos(angle) - 1), y + 0.03 * math.sin(angle), z)
        assert each.target_m == pytest.approx(on_circle, abs=1e-12)
    assert len(set(angles)) == len(angles), "it moves on"
