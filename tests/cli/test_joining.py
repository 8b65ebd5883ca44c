"""`cogrip join` before anything is sent: link or address, device, advice; and the display of an observer."""

import io
import re
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import msgspec
import numpy as np
import pytest

from cogrip.analysis.advice.advice import Advice
from cogrip.analysis.linear.linear_session import ModelError
from cogrip.analysis.linear.stability import Limit, StabilityVerdict
from cogrip.cli.session import join, join_target, joined_device
from cogrip.cli.session.observe import Every, line, table
from cogrip.cli.terminal.problem import BadInput
from cogrip.client.inputs import Connect
from cogrip.client.io.paths import Paths
from cogrip.client.loop import LiveClient
from cogrip.client.observer import ObserverCore
from cogrip.devices.registry import make
from cogrip.protocol.io.dtls_client import DtlsClient
from cogrip.protocol.secure.channel import UnencryptedChannel
from cogrip.protocol.settings.room import resolve, seat_settings
from cogrip.protocol.wire import messages
from cogrip.protocol.wire.messages import Hello, Stamp, View, Welcome
from cogrip.protocol.wire.session import ClientSession

from tests.cli.command import Cogrip, printed

FINGERPRINT, TOKEN = "0123456789abcdef" * 4, "tokentokentokentoken_-"
LINK = f"cogrip://127.0.0.1:4711/lab#{FINGERPRINT}.{TOKEN}"
NO_NAME = "an observer has no seat: --name has no effect"
Asked = Callable[..., tuple[Hello, Paths]]


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        ([LINK, "--insecure"], 2, "--insecure is for HOST:PORT; with a link everything is encrypted"),
        ([LINK, "--room", "attic"], 2, "room 'attic' is asked for, and the link is for 'lab'"),
        ([LINK[:-3]], 2, "the token has 19 characters"),
        ([LINK, "--observe", "--device", "sim:phantom"], 2, "--observe needs no --device"),
        ([LINK, "--observe", "--device", "sim:ideal", "--device", "web"], 2, "--observe needs no --device"),
        (
            [LINK, "--device", "hid:1", "--device", "hid:1#pose=home"],
            2,
            "--device hid:1 is given twice, and two arms need",
        ),
        ([LINK, *["--device", "sim:ideal"] * 3], 2, "--device is given 3 times; a person has two arms"),
        ([LINK, *["--device", "sim:ideal"] * 2, "--speed", "2"], 2, "write them as keys of its address"),
        ([LINK, "--device", "sim:ideal", "--device", "sim:idol"], 2, "sim:idol"),
        (
            [LINK, "--port", "47800"],
            2,
            "--port is of a page: give --view or --device web as well; the port of a server",
        ),
        ([LINK, "--foxglove"], 2, "--foxglove is of a page"),
        ([LINK, "--device", "web", "--port", "70000"], 2, "--port 70000 is outside 0 to 65535"),
        ([LINK, "--view", "--foxglove-origin", "https://a.example"], 2, "--foxglove-origin: goes with --foxglove"),
        ([LINK, "--device", "web", "--foxglove", "--foxglove-origin", "a.example"], 2, "is no origin"),
        ([LINK, "--device", "web", "--device", "sim:ideal", "--port", "8000"], 2, "--port is of a page"),
        (["192.0.2.7:47800"], 1, "192.0.2.7 is not this machine"),
        (["192.0.2.7", "--observe"], 1, "use the join link that the server printed (cogrip://...); --insecure"),
        (["no-such-host.invalid"], 1, "check the server's name"),
        (["127.0.0.1:0"], 2, "write HOST:PORT, such as 127.0.0.1:47800, or the server's join link"),
        (["::1"], 2, "an IPv6 address stands in brackets"),
        ([LINK.removeprefix("cogrip://")], 2, "a join link begins with cogrip://"),
        ([LINK.partition("/lab")[2]], 2, "a join link begins with cogrip://"),
        ([f"cdef.{TOKEN}"], 2, "this is the end of a join link: paste it whole"),
        ([f"-{TOKEN}"], 2, "unknown option before the server"),
        ([f"--{TOKEN}"], 2, "unknown option before the server"),
        (["--devcie", "x", LINK], 2, "unknown option --devcie before the server"),
        ([LINK, "--devcie", "x"], 2, "did you mean --device?"),
        ([LINK, "x"], 2, "one link or HOST:PORT is needed, and 2 words stand there"),
        (["my", "link:", LINK], 2, "one link or HOST:PORT is needed, and 3 words stand there"),
        (["cogrip", "join"], 2, "host: there is none"),
    ],
)
def test_what_cannot_be_joined_is_refused_in_words_without_the_secret(
    cogrip: Cogrip, arguments: list[str], code: int, words: str
) -> None:
    found, said, problems = cogrip("join", *arguments)
    assert (found, said) == (code, "")
    assert words in problems
    assert TOKEN[:19] not in problems
    assert FINGERPRINT not in problems


def test_the_end_of_a_link_is_not_looked_up(cogrip: Cogrip, monkeypatch: pytest.MonkeyPatch) -> None:
    looked_up: list[object] = []
    monkeypatch.setattr(join_target, "find", lambda *where: looked_up.append(where))
    for text in (f"{FINGERPRINT}.{TOKEN}", f"cdef.{TOKEN}", FINGERPRINT, f"#{FINGERPRINT}.{TOKEN}", f"lab#{TOKEN}"):
        assert cogrip("join", text)[0] == 2
    assert looked_up == []


@pytest.fixture
def asked(cogrip: Cogrip, monkeypatch: pytest.MonkeyPatch) -> Asked:
    """Return the hello and the paths of `join`, caught where the client would start."""

    def run(*arguments: str) -> tuple[Hello, Paths]:
        found: list[tuple[Any, Paths]] = []

        def caught(hello: object, paths: Paths) -> None:
            found.append((hello, paths))
            raise BadInput("nobody is there")

        monkeypatch.setattr(join, "LiveClient", lambda arm, hello, paths, *_, **__: caught(hello, paths))
        monkeypatch.setattr(
            join, "observe_room", lambda session, paths, *_: caught(messages.decode(session.hello), paths)
        )
        assert cogrip("join", *arguments)[0] == 2
        ((hello, paths),) = found
        return hello, paths

    return run


def test_a_link_is_all_that_is_needed(asked: Asked) -> None:
    hello, calls = asked(LINK)
    assert (hello.room, hello.role, hello.token, hello.ticket) == ("lab", "player", TOKEN, "")
    assert (calls.server.host, calls.server.port) == ("127.0.0.1", 4711)
    assert isinstance(calls.make_channel(), DtlsClient), "with a link everything is encrypted"


SIGNED = f"eyJhbGciOiJFZERTQSJ9.{'c' * 300}.{'s' * 86}"


@pytest.mark.parametrize("text", [SIGNED, f"cdef.{SIGNED}", f"lab#{SIGNED}", SIGNED[:380]])
def test_the_end_of_a_link_with_a_signed_token_is_neither_looked_up_nor_shown(
    cogrip: Cogrip, monkeypatch: pytest.MonkeyPatch, text: str
) -> None:
    looked_up: list[object] = []
    monkeypatch.setattr(join_target, "find", lambda *where: looked_up.append(where))
    code, _, problems = cogrip("join", text)
    assert (code, looked_up) == (2, [])
    assert "cccc" not in problems
    assert "ssss" not in problems


def test_a_signed_token_is_said_whole_and_beside_it_names_must_fit(asked: Asked) -> None:
    longest = "eyJ.b." + "c" * 634
    link = f"cogrip://127.0.0.1:4711/#{FINGERPRINT}.{longest}"
    assert asked(link, "--name", "n" * 40, "--room", "r" * 40)[0].token == longest
    target = join_target.target_of(link, "\U0001f600" * 40, False, "\U0001f600" * 40, "")
    record = make("sim:ideal").capability
    assert target.player(record, "sim:ideal").token == longest
    with pytest.raises(
        BadInput, match=r"make a hello of 12\d\d bytes, and 1195 fit: names of rooms and seats have"
    ) as caught:
        target.player(record, "sim:" + "x" * 196)
    assert "ccc" not in str(caught.value)


@pytest.mark.parametrize("pasted", [f"<{LINK}>", f"'{LINK}'", f" cogrip join '{LINK}'\n"])
def test_a_link_is_taken_as_it_was_pasted(
    cogrip: Cogrip, asked: Asked, monkeypatch: pytest.MonkeyPatch, pasted: str
) -> None:
    assert asked(pasted)[0].token == TOKEN
    assert asked("cogrip", "join", pasted)[0].token == TOKEN
    monkeypatch.setattr("sys.stdin", io.StringIO(f"{pasted.strip()}\nmore\n"))
    assert asked("-")[0].token == TOKEN
    monkeypatch.setattr("sys.stdin", io.StringIO("\n"))
    assert "standard input has no join link in its first line" in cogrip.err("join", "-")


def test_a_hello_claims_its_devices_record(asked: Asked) -> None:
    hello, _ = asked("127.0.0.1", "--device", "sim:phantom?hand=hold")
    record = make("sim:phantom?hand=hold", axes=3).capability
    assert hello.device_force_n == record.peak_force_n
    assert hello.device_speed_mps == min(record.speed_mps, messages.NO_BOUND)
    assert (hello.token, hello.device_axes) == ("", 3)
    hello, _ = asked(LINK, "--observe")
    assert (hello.role, hello.token, hello.device) == ("observer", TOKEN, "none")


@pytest.mark.parametrize("where", ["127.0.0.1:4711", "localhost:4711", "[::1]:4711", "192.0.2.7:4711 --insecure"])
def test_encryption_is_not_needed_on_loopback_or_where_that_is_said(asked: Asked, where: str) -> None:
    _, calls = asked(*where.split())
    assert calls.server.port == 4711
    assert isinstance(calls.make_channel(), UnencryptedChannel)


def test_a_name_has_no_effect_on_an_observer(cogrip: Cogrip, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(join, "observe_room", lambda *_: 0)
    assert cogrip("join", LINK, "--observe") == (0, "", "")
    assert cogrip("join", LINK, "--observe", "--name", "anna") == (0, f"{NO_NAME}\n", "")

    def client(_: object, hello: bytes, *__: object, **___: object) -> SimpleNamespace:
        return SimpleNamespace(run=lambda: ClientSession(hello))

    monkeypatch.setattr(join, "LiveClient", client)
    assert cogrip("join", LINK) == (0, "", "")
    assert cogrip("join", LINK, "--name", "anna") == (0, f"{NO_NAME}\n", "")


# Advice on a seat, whatever the server asks for ---------------------------------------------------------------------


def warned(monkeypatch: pytest.MonkeyPatch, raises: Exception | None = None, **sections: object) -> tuple[str, int]:
    """Return the printed warnings, and how often the model was asked."""
    seat = seat_settings(resolve({"users": [{"name": "a"}], **sections}), 0)
    record = make("sim:phantom?hand=hold", axes=1).capability
    asked: list[object] = []

    def advise_seat(*what: object) -> Advice:
        asked.append(what)
        if raises is not None:
            raise raises
        return Advice(StabilityVerdict("passive", 0.5, 0.5, (), 1), Limit(None, 1.0), 1.0, (), ())

    monkeypatch.setattr(joined_device, "advise_seat", advise_seat)
    said: list[str] = []
    assert joined_device.judge_seat("sim:phantom", False, said.append, seat, record) == ""
    return "".join(f"{line}\n" for line in said), len(asked)


@pytest.mark.parametrize("error", [ModelError, ValueError, OverflowError, ZeroDivisionError, np.linalg.LinAlgError])
def test_a_model_that_breaks_is_no_reason_to_stay_away(monkeypatch: pytest.MonkeyPatch, error: type[Exception]) -> None:
    assert warned(monkeypatch, error("not of this world")) == ("warning: no advice: not of this world\n", 1)


FRAME_MS = 1e3 / 128
COUPLING = {"kind": "coupling"}
LINKED: dict[str, Any] = {"link": {"delay_ms": 48 * FRAME_MS}}


@pytest.mark.parametrize(
    ("longest", "longer"),
    [
        (LINKED, {"link": {**LINKED["link"], "up": {"delay_ms": 49 * FRAME_MS}}}),
        ({"playout": {"frames": 48}}, {"playout": {"frames": 49}}),
        ({"playout": {"frames": 20}, "coupling": COUPLING}, {"playout": {"frames": 21}, "coupling": COUPLING}),
        ({"rates": {"device_hz": 256, "network_hz": 1}}, {"rates": {"device_hz": 257, "network_hz": 1}}),
    ],
    ids=["link", "playout", "virtual coupling", "rates"],
)
def test_a_model_that_would_take_for_ever_is_not_asked(monkeypatch: pytest.MonkeyPatch, longest, longer) -> None:
    assert warned(monkeypatch, **longest) == ("", 1)
    assert warned(monkeypatch, **longer) == ("warning: no advice: the delays are too long for the model\n", 0)


# Display of an observer ----------------------------------------------------------------------------------------------


def seeing(view: View | None) -> ObserverCore:
    seat = msgspec.structs.replace(seat_settings(resolve({"users": [{"name": "a"}]}), 0), user="observer 1")
    hello = join_target.JoinTarget("127.0.0.1", 1, "").observer()
    core = ObserverCore(ClientSession(hello))
    core.handle(Connect(), 0)
    core.receive(messages.encode(Welcome(3, hello.nonce, 5, "", "1", seat, "t", "observer")), 0)
    if view is not None:
        core.receive(messages.encode(view), 0)
    return core


VIEW = View(5, 1, (0.012, -0.003, 0.1, 0.0), (0, 2), (0.013, 0.0, 0.011, 0.0), (1.25, 0.0, -1.25, 0.5), Stamp(1))


def test_a_line_says_where_everything_is() -> None:
    assert line(seeing(None), 0) == "no view yet"
    assert line(seeing(VIEW), 40_000_000) == (
        "object at +12.0 -3.0 mm, +100.0 +0.0 mm/s, 40 ms ago; "
        "seat 0 at +13.0 +0.0 mm, +1.25 +0.00 N; seat 2 at +11.0 +0.0 mm, -1.25 +0.50 N"
    )


def test_a_table_has_a_row_a_hand() -> None:
    shown = printed(table(seeing(VIEW), 5_000_000), 100)
    rows = [text.split() for text in shown.splitlines()]
    assert ["0", "+13.0", "+0.0", "+1.25", "+0.00"] in rows
    assert ["2", "+11.0", "+0.0", "-1.25", "+0.50"] in rows
    assert "5 ms ago" in shown


def test_drawing_keeps_its_pace() -> None:
    drawn: list[int] = []
    every = Every(100, drawn.append)
    for now_ns in range(0, 1000, 30):
        every.show(seeing(None), now_ns)
    assert drawn == [0, 120, 240, 360, 480, 600, 720, 840, 960]


def test_a_replay_of_nothing_asks_for_no_seat(run: Path, cogrip: Cogrip, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(LiveClient, "run", lambda _: pytest.fail("the server was asked"))
    out, err = cogrip.texts("join", "127.0.0.1:1", "--device", f"replay:{run}#user=anna&start_s=500", code=2)
    assert out == ""
    assert "from 500 s to 0.5" in err
    assert "there is nothing to play; the recording is 0.5" in err
    assert err.count("\n") == 1


PHANTOM = {"users": [{"name": "anna", "device": "sim:ideal?axes=1"}, {"name": "ben", "device": "serial:/dev/arm"}]}


@pytest.mark.parametrize(
    ("devices", "name", "told"),
    [
        ((), None, ("sim:phantom?hand=hold&x=1",)),
        (("sim:ideal",), None, ("sim:ideal?hand=hold&x=1",)),
        (("emulated:haply?axes=3",), None, ("emulated:haply?axes=3&hand=hold&x=1",)),
        ((), "", ("sim:ideal?axes=1&hand=hold&x=1",)),
        ((), "ben", "--hand 'hold&x=1': is for a simulated device, and serial:/dev/arm is none"),
        (("web:",), None, "is for a simulated device, and web: is none"),
        (("sim:phantom?hand=reach",), None, "sim:phantom?hand=reach has a hand already"),
        (("sim:phantom", "sim:phantom"), None, "is for one device"),
    ],
)
def test_a_hand_is_that_of_the_simulated_device(
    devices: tuple[str, ...], name: str | None, told: tuple[str, ...] | str
) -> None:
    settings = None if name is None else resolve(PHANTOM)
    if isinstance(told, str):
        with pytest.raises(BadInput, match=re.escape(told)):
            joined_device.with_hand(devices, "hold&x=1", settings, name or "")
    else:
        assert joined_device.with_hand(devices, "hold&x=1", settings, name or "") == told
    assert joined_device.with_hand(devices, "", settings, name or "") == devices


def test_join_tells_the_server_the_device_with_its_hand(asked: Asked) -> None:
    hello, _ = asked("127.0.0.1:4711", "--hand", "hold", "--device", "sim:ideal")
    assert hello.device == "sim:ideal?hand=hold"
