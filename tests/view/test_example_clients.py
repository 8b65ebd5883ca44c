"""The example clients of `docs/view.md`: they print what was sent, play a recording, and lead a hand in a circle."""

import math
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from cogrip.devices.web.messages import OwnHand, Pointer, decode_pointer, encode_own_hand
from cogrip.view.frames import Frame, PersonFrame, decode_chunk, encode
from cogrip.view.recording import open_view
from cogrip.view.scene import Scene, to_json

from tests.view.page_server import TOKEN, PageServer, serving
from tests.view.pictured import scene
from tests.view.recorded_runs import recorded_run

EXAMPLES = Path(__file__).parents[2] / "docs" / "examples"
LIMIT_S = 60.0
HALF_OF_THE_LAST_DIGIT_MM = 0.0005 + 1e-9
SEEN = re.compile(r"(-?[\d.]+) s  object (\S+ \S+ \S+)((?:  \w+ \w+ \S+ \S+ \S+ force \S+ N)*)")
PERSON = re.compile(r"(\w+) (\w+) (\S+ \S+ \S+) force (\S+) N")


def node() -> list[str]:
    """Return how to start Node with a global WebSocket: as it is from 22 on, behind a flag in 20."""
    program = shutil.which("node")
    if program is None:
        pytest.skip("Node is not here")
    asks = ["--eval", "process.exit(globalThis.WebSocket ? 0 : 1)"]
    for flags in ([], ["--no-warnings", "--experimental-websocket"]):
        if subprocess.run([program, *flags, *asks], capture_output=True, timeout=LIMIT_S, check=False).returncode == 0:
            return [program, *flags]
    pytest.skip("Node is here, but has no WebSocket: it is older than 20.10")


@pytest.fixture(params=["view_client.py", "view_client.js"])
def command(request: pytest.FixtureRequest) -> list[str]:
    begin = [sys.executable] if request.param.endswith(".py") else node()
    return [*begin, str(EXAMPLES / request.param)]


@contextmanager
def started(command: list[str], *arguments: str) -> Iterator[subprocess.Popen[str]]:
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    with subprocess.Popen([*command, *arguments], **pipes, text=True) as client:  # type: ignore[call-overload]
        try:
            yield client
        finally:
            client.kill()


def moment(number: int) -> Frame:
    """Return a frame of anna, who holds on, and ben, who is not there any more."""
    here = (0.01 * math.sin(number), -0.02, 0.001 * number)
    anna = PersonFrame(0, "degraded", hand_m=(1 / 3, -0.05, 0.007 * number), force_n=(3.0, 4.0 * number, 0.0))
    return Frame(3, number, 100.0 + number / 64, here, (0.0, 0.0, 0.0), (anna, PersonFrame(1)))


def assert_printed(line: str, frame: Frame, told: Scene) -> None:
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
        for _ in range(3):
            server.send(encode_own_hand(OwnHand("live", 0, begin_m, (0.0, 0.0, 0.0), 3.0)))
        said: list[Pointer] = []
        while len(said) < 20:
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


def test_client_plays_what_cogrip_view_serves(command: list[str], tmp_path: Path) -> None:
    """The real server lets it in, without a browser's Origin; all frames of two chunks come."""
    run = recorded_run(tmp_path / "run", 11.0)
    recorded = open_view(run)
    serve = [sys.executable, "-m", "cogrip.cli", "view", str(run), "--no-browser"]
    with started(serve) as server:
        address = re.search(r"http://\S+", server.stdout.readline())  # type: ignore[union-attr]
        assert address
        with started(command, address[0]) as client:
            printed, errors = client.communicate(timeout=LIMIT_S)
    assert errors == ""
    of_run = recorded.scene
    assert of_run.chunks == 2
    frames = [each for number in range(2) for each in decode_chunk(recorded.chunk(number), len(of_run.people))[1]]
    lines = printed.splitlines()
    assert len(lines) == len(frames)
    for line, frame in zip(lines[::50], frames[::50], strict=True):
        assert_printed(line, frame, of_run)
    assert_printed(lines[-1], frames[-1], of_run)
