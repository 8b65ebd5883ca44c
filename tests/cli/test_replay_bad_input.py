"""Refusals of `cogrip replay` and of `join` with a replay: the input is named, and nothing is left."""

import shutil
from pathlib import Path
from typing import Any

import pytest

from cogrip.cli.session import join
from cogrip.cli.terminal.problem import BadInput
from cogrip.devices import Device
from cogrip.protocol.wire.messages import Hello

from tests.cli.command import Cogrip
from tests.cli.spoiled_runs import ANNA, SERVER
from tests.recording_files import rewrite

REFUSED = {
    "run": "say either --verify or --what-if",
    "run --verify --what-if": "say either --verify or --what-if",
    "run --verify --set seed=2": "--set goes with --what-if",
    "run --what-if --json -": "--json goes with --verify",
    "run/settings.json --verify": "is not a recording (no MCAP file); name a run folder or its .mcap file",
    "empty --verify": "empty holds no recording that can be read",
    "run --what-if --set nonsense": "section.key=value",
    "run --what-if --set coupling.impedence_nspm=50": "did you mean coupling.impedance_nspm?",
    "run --what-if --set users.0.device=sim:phantm": "sim:phantm",
    "run --what-if --hands impedance --set rates.device_hz=2048": "was recorded at 1024 Hz",
    "run --what-if --hands both": "both",
    "run --what-if --hands positions --set object.axes=3": "was recorded on 1 axes, 3 are asked for",
    "run/client-anna.mcap --what-if": "holds no recording of the server",
    "run --what-if --runs /proc/x": "no folder can be made there",
}


@pytest.mark.parametrize("arguments", REFUSED)
def test_bad_input_is_named_and_nothing_is_left(run: Path, cogrip: Cogrip, arguments: str) -> None:
    Path("empty").mkdir()
    cogrip.refuses(REFUSED[arguments], f"replay {arguments}")


@pytest.mark.parametrize(
    ("header", "words"),
    [
        ({"format": 2}, "is a recording of format 2, newer than 1, the newest known here; update cogrip"),
        ({"start": "{}"}, "cannot be replayed"),
        ({"role": "spectator"}, "is of a 'spectator'; only client and server can be replayed"),
    ],
)
def test_files_that_cannot_be_replayed_say_why(run: Path, cogrip: Cogrip, header: dict[str, Any], words: str) -> None:
    rewrite(run / ANNA, **header)
    cogrip.refuses(words, "replay", run / ANNA, "--verify")


@pytest.mark.parametrize("start", ["{}", "no JSON"])
@pytest.mark.parametrize(("file", "what"), [(SERVER, "its settings"), (ANNA, "what device was recorded")])
def test_a_header_that_cannot_be_read_is_bad_input_for_what_if(
    run: Path, cogrip: Cogrip, file: str, what: str, start: str
) -> None:
    rewrite(run / file, start=start)
    cogrip.refuses(f"{run / file} does not say {what}: ", "replay", run, "--what-if", "--runs", "other")


@pytest.mark.parametrize(
    ("device", "words"),
    [
        ("replay:nowhere", "there is no such run; name a run folder or a .mcap file"),
        ("replay:nowhere --axes 1", "there is no such run; name a run folder or a .mcap file"),
        ("replay:run#user=bem", "no recording of user bem; there is: 0 (anna), 1 (ben); write #user=ben"),
        ("replay:run#user=bem --axes 1", "no recording of user bem; there is: 0 (anna), 1 (ben)"),
        ("replay:run#user=anna --axes 3", "was recorded on 1 axes, 3 are asked for"),
        ("replay:alone#user=1", "there is: 0 (anna); write #user=anna"),
        ("sim:phantm", "sim:phantm"),
    ],
)
def test_joining_with_a_device_that_cannot_be_played(run: Path, cogrip: Cogrip, device: str, words: str) -> None:
    Path("alone").mkdir()
    shutil.copy(run / ANNA, "alone")
    cogrip.refuses(words, "join", "127.0.0.1:1", "--device", *device.split())


@pytest.mark.parametrize(
    ("device", "more", "axes"),
    [("replay:run#user=anna", (), 1), ("replay:run#user=anna", ("--axes", 1), 1), ("sim:ideal", (), 3)],
)
def test_joining_takes_the_axes_that_were_recorded(
    run: Path, cogrip: Cogrip, monkeypatch: pytest.MonkeyPatch, device: str, more: tuple[object, ...], axes: int
) -> None:
    """The hello is caught where the client would start."""
    asked: list[tuple[int, int]] = []

    def client(arm: Device, hello: Hello, *_: object) -> None:
        asked.append((hello.device_axes, arm.capability.axes))
        raise BadInput("nobody is there")

    monkeypatch.setattr(join, "LiveClient", client)
    assert cogrip("join", "127.0.0.1:1", "--device", device, *more)[0] == 2
    assert asked == [(axes, axes)]
