"""`cogrip relay`: what is said of a wrong flag, and that flags and files reach the link."""

import json
import socket
from pathlib import Path

import pytest

from tests.cli.spoiled_runs import Cogrip

TO = ("--to", "127.0.0.1:9", "--listen", "127.0.0.1:0", "--seconds", "0.001")
TRACE = "t_s,delay_ms\n0,5\n1,lost\n"


@pytest.fixture(autouse=True)
def _here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "300")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--to", "nowhere.invalid"), "--to nowhere.invalid:47800: "),
        (("--to", "a:b:c"), "--to 'a:b:c': an IPv6 address stands in brackets"),
        (("--to", "127.0.0.1", "--listen", "127.0.0.1:99999"), "--listen '127.0.0.1:99999': the port must be a number"),
        (("--to", "127.0.0.1", "--listen", "192.0.2.1:0"), "--listen 192.0.2.1:0 is no address of this machine"),
        (("--to", "[::1]:7", "--listen", "[::1]:0", "--flows", "0"), "--flows 0 is outside 1 to 400"),
        ((*TO, "--flows", "401"), "--flows 401 is outside 1 to 400"),
        ((*TO, "--idle-s", "0.5"), "--idle-s 0.5 is outside 1 to 1000000"),
        ((*TO[:-1], "0"), "--seconds 0 is no time to relay"),
        ((*TO, "--set", "coupling.kind=wave"), "--set coupling.kind=wave: the relay takes keys of [link] only"),
        ((*TO, "--set", "link.los=0.1"), "link.los: there is no such setting; did you mean link.loss?"),
        ((*TO, "--set", "link.outage_s=1"), "link.up.outage_s = 1: link.up.outage_every_s"),
        ((*TO, "--up-trace", "none.csv"), "none.csv: cannot be read: No such file or directory"),
        ((*TO, "--outages", "none.csv"), "--outages none.csv: cannot be read: No such file or directory"),
        (("file.toml", *TO, "--profile", "lan"), "--profile and a settings file exclude each other"),
        (("none.toml", *TO), "none.toml: there is no such file"),
    ],
)
def test_a_wrong_flag_is_answered_with_its_cure(cogrip: Cogrip, arguments: tuple[str, ...], words: str) -> None:
    code, _, said = cogrip("relay", *arguments)
    assert code == 2
    assert words in said


def test_a_port_in_use_and_itself_are_refused(cogrip: Cogrip) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as used:
        used.bind(("127.0.0.1", 0))
        port = used.getsockname()[1]
        code, _, said = cogrip("relay", "--to", "127.0.0.1:9", "--listen", f"127.0.0.1:{port}")
        assert code == 1
        assert f"cannot listen on 127.0.0.1:{port}: Address already in use; choose another port" in said
    for listen in ("127.0.0.1", "0.0.0.0"):
        code, _, said = cogrip("relay", "--to", f"127.0.0.1:{port}", "--listen", f"{listen}:{port}")
        assert code == 2
        assert f"--to 127.0.0.1:{port} is where the relay itself listens" in said


def test_an_unknown_profile_is_answered_with_the_known_ones(cogrip: Cogrip) -> None:
    code, out, said = cogrip("relay", *TO, "--profile", "wlan")
    assert code == 2
    assert all(name in out + said for name in ("wlan", "lan", "wifi", "wan", "lte", "satellite"))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (
            "start,length\n",
            "o.csv:1: the first line is 'start,length'; it must be start_s,length_s or start_s,length_s,way",
        ),
        (
            "start_s,length_s\n1,0\n",
            "o.csv:2: an outage of 0 s at 1 s: it must be longer than 0 and begin at 0 or later",
        ),
        ("start_s,length_s\n-1,1\n", "o.csv:2: an outage of 1 s at -1 s"),
        ("start_s,length_s\n1,x\n", "o.csv:2: 1,x: start_s and length_s must be numbers"),
        ("start_s,length_s\n1\n", "o.csv:2: 1 columns"),
        ("start_s,length_s,way\n1,1,left\n", "o.csv:2: way = 'left': write up, down, or nothing for both"),
    ],
)
def test_what_is_said_of_a_wrong_script(cogrip: Cogrip, text: str, words: str) -> None:
    Path("o.csv").write_text(text)
    code, _, said = cogrip("relay", *TO, "--outages", "o.csv")
    assert code == 2
    assert words in said


def test_flags_and_files_reach_the_link(cogrip: Cogrip) -> None:
    Path("t.csv").write_text(TRACE)
    Path("o.csv").write_text("start_s,length_s,way\n1,2,up\n\n3,1,\n5,1,down\n6,1,up\n")
    code, out, _ = cogrip(
        "relay", *TO, "--profile", "lte", "--set", "link.down.loss=0.25", "--seed", "9", "--up-trace", "t.csv", "--outages",
        "o.csv", "--json", "told.json",
    )  # fmt: skip
    assert code == 0
    told = json.loads(Path("told.json").read_text())
    assert (told["profile"], told["seed"], told["stopped"]) == ("lte", 9, "the time is over")
    assert (told["link"]["up"]["delay_ms"], told["link"]["down"]["delay_ms"]) == (25.0, 15.0)
    assert (told["link"]["up"]["loss"], told["link"]["down"]["loss"]) == (0.001, 0.25)
    assert (told["link"]["up"]["trace"], told["link"]["down"]["trace"]) == (str(Path("t.csv").absolute()), "")
    assert "up: 25 ms, jitter 6 ms, loss 0.1 % in runs of 5, 3 outages by script, trace /" in out
    assert "down: 15 ms, jitter 3 ms, loss 25 % in runs of 5, 2 outages by script" in out
    assert "relaying from 127.0.0.1:" in out


def test_a_settings_files_link_and_seed_are_taken_and_its_trace_lies_beside_it(cogrip: Cogrip) -> None:
    Path("deep").mkdir()
    Path("deep/t.csv").write_text(TRACE)
    Path("deep/storm.toml").write_text(
        'seed = 5\n[link]\ndelay_ms = 3.0\noutages = [[1, 2]]\n[link.down]\ntrace = "t.csv"\n'
    )
    code, out, said = cogrip("relay", "deep/storm.toml", *TO, "--json", "told.json")
    assert code == 0, said
    told = json.loads(Path("told.json").read_text())
    assert told["seed"] == 5
    assert told["link"]["down"]["trace"] == str(Path("deep/t.csv").absolute())
    assert "up: 3 ms, 1 outage by script" in out


@pytest.mark.parametrize("key", ["outages = [[1, 2]]", 'trace = "t.csv"'])
def test_a_server_refuses_what_no_welcome_carries(cogrip: Cogrip, key: str) -> None:
    Path("t.csv").write_text(TRACE)
    Path("storm.toml").write_text(f"[link]\n{key}\n")
    code, _, said = cogrip("serve", "storm.toml", "--port", "0")
    assert code == 2
    assert f"storm.toml: link.{key.partition(' ')[0]}: no welcome carries it" in said
    assert "cogrip relay" in said
