"""What `cogrip join` is told by a link or an address, before anything is sent; and what an observer is shown."""

import io

import msgspec
import pytest
from rich.console import Console

from cogrip.cli import join
from cogrip.cli.look_on import Every, line, table
from cogrip.cli.problem import BadInput
from cogrip.client.io.calls import Calls
from cogrip.client.observer import ObserverCore
from cogrip.devices.device import Device
from cogrip.protocol import messages
from cogrip.protocol.channel import PlainChannel
from cogrip.protocol.io.sealed_call import SealedCall
from cogrip.protocol.messages import Hello, Stamp, View, Welcome
from cogrip.protocol.session import ClientSession
from cogrip.protocol.settings import resolve, seat_settings

from tests.cli.spoiled_runs import Cogrip

FINGERPRINT, TOKEN = "0123456789abcdef" * 4, "tokentokentokentoken_-"
LINK = f"cogrip://127.0.0.1:4711/lab#{FINGERPRINT}.{TOKEN}"


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        ([LINK, "--insecure"], 2, "--insecure is for HOST:PORT; with a link everything is sealed"),
        ([LINK, "--room", "attic"], 2, "room 'attic' is asked for, and the link is for 'lab'"),
        ([LINK[:-3]], 2, "the token has 19 characters"),
        ([LINK.partition("#")[0]], 2, "there is no # with fingerprint and token behind it"),
        ([LINK, "--observe", "--device", "sim:phantom"], 2, "--observe needs no --device"),
        (["192.0.2.7:47800"], 1, "192.0.2.7 is not this machine"),
        (["192.0.2.7", "--observe"], 1, "use the join link that the server printed (cogrip://...); --insecure"),
        (["no-such-host.invalid"], 1, "check the server's name"),
        (["127.0.0.1:0"], 2, "write HOST:PORT, such as 127.0.0.1:47800, or the server's join link"),
        (["::1"], 2, "an IPv6 address stands in brackets"),
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


def asked(cogrip: Cogrip, monkeypatch: pytest.MonkeyPatch, *arguments: str) -> tuple[Hello, Calls]:
    """What would go to the server, looked at where it would go out."""
    found: list[tuple[Hello, Calls]] = []

    def client(arm: Device, hello: Hello, calls: Calls, *_: object) -> None:
        found.append((hello, calls))
        raise BadInput("nobody is there")

    def look_on(session: ClientSession, calls: Calls, *_: object) -> None:
        hello = messages.decode(session.hello)
        assert isinstance(hello, Hello)
        found.append((hello, calls))
        raise BadInput("nobody is there")

    monkeypatch.setattr(join, "LiveClient", client)
    monkeypatch.setattr(join, "look_on", look_on)
    assert cogrip("join", *arguments)[0] == 2
    [(hello, calls)] = found
    return hello, calls


def test_a_link_is_all_that_is_needed(cogrip: Cogrip, monkeypatch: pytest.MonkeyPatch) -> None:
    hello, calls = asked(cogrip, monkeypatch, LINK)
    assert (hello.room, hello.role, hello.token, hello.ticket) == ("lab", "player", TOKEN, "")
    assert (calls.server.host, calls.server.port) == ("127.0.0.1", 4711)
    assert isinstance(calls.make_channel(), SealedCall), "with a link nothing is ever said in the open"


def test_a_hello_claims_its_devices_record(cogrip: Cogrip, monkeypatch: pytest.MonkeyPatch) -> None:
    hello, calls = asked(cogrip, monkeypatch, "127.0.0.1", "--device", "sim:phantom?hand=hold")
    record = join.make("sim:phantom?hand=hold", axes=3).capability
    assert (hello.device_force_n, hello.device_speed_mps) == (
        record.peak_force_n,
        min(record.speed_mps, messages.NO_BOUND),
    )
    assert (hello.token, hello.device_axes) == ("", 3)
    assert isinstance(calls.make_channel(), PlainChannel)


@pytest.mark.parametrize("where", ["127.0.0.1:4711", "localhost:4711", "[::1]:4711"])
def test_this_machine_may_be_spoken_to_in_the_open(cogrip: Cogrip, monkeypatch: pytest.MonkeyPatch, where: str) -> None:
    assert asked(cogrip, monkeypatch, where)[1].server.port == 4711


def test_another_one_only_where_that_is_asked_for(cogrip: Cogrip, monkeypatch: pytest.MonkeyPatch) -> None:
    _, calls = asked(cogrip, monkeypatch, "192.0.2.7", "--insecure")
    assert isinstance(calls.make_channel(), PlainChannel)


def test_an_observer_needs_no_device(cogrip: Cogrip, monkeypatch: pytest.MonkeyPatch) -> None:
    hello, _ = asked(cogrip, monkeypatch, LINK, "--observe")
    assert (hello.role, hello.token, hello.device) == ("observer", TOKEN, "none")


# What an observer is shown ----------------------------------------------------------------------------------------------


def seeing(view: View | None) -> ObserverCore:
    seat = msgspec.structs.replace(seat_settings(resolve({"users": [{"name": "a"}]}), 0), user="observer 1")
    hello = join.Wanted(join.Place("127.0.0.1", 1, ""), "", "").to_look_on()
    core = ObserverCore(ClientSession(hello))
    core.call(0)
    core.receive(messages.encode(Welcome(2, hello.nonce, 5, "", "1", seat, "t", "observer")), 0)
    if view is not None:
        core.receive(messages.encode(view), 0)
    return core


VIEW = View(5, 1, (0.012, -0.003, 0.1, 0.0), (0, 2), (0.013, 0.0, 0.011, 0.0), (1.25, 0.0, -1.25, 0.5), Stamp(1))


def test_a_line_says_where_everything_is() -> None:
    assert line(seeing(None), 0) == "nothing seen yet; nobody holds it"
    assert line(seeing(VIEW), 40_000_000) == (
        "object at +12.0 -3.0 mm, +100.0 +0.0 mm/s, 40 ms ago; "
        "seat 0 at +13.0 +0.0 mm, +1.25 +0.00 N; seat 2 at +11.0 +0.0 mm, -1.25 +0.50 N"
    )


def test_a_table_has_a_row_a_hand() -> None:
    console = Console(file=io.StringIO(), width=100)
    console.print(table(seeing(VIEW), 5_000_000))
    shown = console.file.getvalue()  # type: ignore[attr-defined]
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
