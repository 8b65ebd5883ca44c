"""Mistakes on the command line: one line each, in one style, with exit code 2."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cogrip.cli.settings.before_run import together
from cogrip.protocol.settings.errors import expects, plain, unit_of

from tests.cli.command import Cogrip

HELP = "--help` shows what it takes"
MISTAKES = {
    "join 127.0.0.1:1 --seconds abc": "--seconds: expects a number, in s; got 'abc'",
    "join 127.0.0.1:1 --seconds -1": "--seconds: expects a number above 0, in s; got -1.0",
    "bench concealment": "benchmarks are run in a checkout of cogrip: `python3 dev.py bench NAME`",
    "demo --seconds 0": "--seconds: expects a number above 0, in s; got 0.0",
    "join 127.0.0.1:1 --axes two": "--axes: expects a whole number; got 'two'",
    "join 127.0.0.1:1 --start-s x": "--start-s: expects a number, in s; got 'x'",
    "join 127.0.0.1:1 --observe=maybe": "--observe: expects true or false; got 'maybe'",
    "serve demo --log xml": '--log: expects "text" or "json"; got \'xml\'',
    "export none --to parqet": (
        '--to: expects "csv", "parquet", "rosbag2", "foxglove" or "bids"; got \'parqet\'; did you mean parquet?'
    ),
    "devices emulate nope": 'KIND: expects "serial", "haply", "hid" or "inverse"; got \'nope\'',
    "join": f"join: SERVER is missing; `cogrip join {HELP}",
    "lab demo --set": f"lab: --set needs a value; `cogrip lab {HELP}",
    "lab demo twice": f"lab: 'twice' is one word too many; `cogrip lab {HELP}",
    "runs --last 3": "runs: there is no option --last; `cogrip runs --help` lists them",
    "serve demo --fresch": "serve: there is no option --fresch; did you mean --fresh?",
    "stability nope": "stability: there is no command 'nope'; there are: radius, limit, region",
    "join 127.0.0.1:1 --seconds cogrip://h:1/r?x": "--seconds: expects another value than a join link",
}
UNITS = {
    "N/m": "coupling.stiffness_npm", "N s/m": "users.0.impedance_nspm", "s": "--start-s seconds", "ms": "link.delay_ms",
    "Hz": "rates.device_hz", "m": "amplitude_m", "m/s": "speed_mps", "N": "force_n", "kg": "object.mass_kg", "mJ": "tank_mj",
    "kbit/s": "rate_kbps", "rad/s": "lowpass_rad_s", "N/s": "slew_nps", "W": "power_w",
    "": "link.loss link.outages.0.1 object.axes name",
}  # fmt: skip


@pytest.mark.parametrize("line", MISTAKES)
def test_a_mistake_is_answered_in_one_line(line: str, cogrip: Cogrip) -> None:
    assert cogrip(line) == (2, "", f"cogrip: {MISTAKES[line]}\n")


@pytest.mark.parametrize(
    ("name", "text", "where"),
    [
        ("a.toml", 'name = "x"\nseconds = = 3\n', "a.toml:2: not valid TOML, at column 11: invalid value"),
        ("b.toml", "[coupling\n", "b.toml:1: not valid TOML, at column 10: expected ']'"),
        ("c.toml", 'name = """x\n\n', "c.toml:3: not valid TOML, at the end of the file: "),
        ("d.json", '{"name": "x",}', "d.json:1: not valid JSON, at column 1"),
    ],
)
def test_a_file_that_cannot_be_read_names_its_line(
    name: str, text: str, where: str, cogrip: Cogrip, tmp_path: Path
) -> None:
    (tmp_path / name).write_text(text)
    err = cogrip.err("lab", tmp_path / name, "--json", "-")
    assert f"/{where}" in err
    assert err.count("\n") == 1


@pytest.mark.parametrize("unit", UNITS)
def test_the_unit_is_the_one_that_the_name_says(unit: str) -> None:
    for name in UNITS[unit].split():
        assert unit_of(name) == unit
        assert expects(name, "a number", "x") == f"{name}: expects a number{f', in {unit}' if unit else ''}; got 'x'"


@given(st.text(max_size=60))
def test_a_message_of_another_kind_is_left_as_it_is(message: str) -> None:
    assert not plain(message) or message.startswith("Expected ")


def test_a_warning_of_several_people_is_said_once() -> None:
    texts = ["anna: soft", "the link: slow", "ben: soft", "anna: soft", "carl: soft"]
    assert together(texts, ["anna", "ben"]) == ["anna, ben: soft", "the link: slow", "carl: soft"]


def test_what_is_refused_is_not_warned_of_as_well(cogrip: Cogrip, tmp_path: Path) -> None:
    twice = "--device emulated:vintage --device emulated:vintage --set coupling.impedance_nspm=20"
    out, err = cogrip.texts(f"lab demo {twice} --runs {tmp_path}", code=2)
    assert out == ""
    (last,) = [line for line in err.splitlines() if "is more than device serial:vintage carries" in line]
    assert last.startswith("cogrip: refused: anna, ben: b = 20 N s/m")
    assert err.splitlines()[-1] == last
