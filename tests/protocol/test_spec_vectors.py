"""SPEC.md is the wire: its vectors, tables and limits, read out of the page and held against the code.

`msgpack` is the independent reader: it shares no code with the msgspec that the product uses.
"""

import json
import re
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import msgpack
import msgspec
import pytest

from cogrip.protocol.io.dtls_client import DtlsClient
from cogrip.protocol.line.receiver import LineReceiver
from cogrip.protocol.line.sender import LineSender
from cogrip.protocol.secure.channel import PEER
from cogrip.protocol.settings import effects
from cogrip.protocol.settings.coupling import Coupling
from cogrip.protocol.settings.hand import HandChange
from cogrip.protocol.settings.link_profile import LinkProfile
from cogrip.protocol.settings.room import resolve
from cogrip.protocol.settings.seat import SeatSettings
from cogrip.protocol.settings.sections import Object, Playout
from cogrip.protocol.wire import accounts, messages, session
from cogrip.protocol.wire.messages import MalformedError, decode, encode
from cogrip.protocol.wire.session import ClientSession
from cogrip.server import unencrypted_channel
from cogrip.server.admission.admission import AdmissionServices
from cogrip.server.admission.tokens import TokenBook
from cogrip.server.core import ServerCore
from cogrip.server.io.dtls_channel import DtlsListener
from cogrip.server.rate_limit import RateLimiter
from cogrip.server.unencrypted_channel import UnencryptedListener

from tests.protocol.spec_page import SPEC, rows, section

VECTOR = re.compile(r"^```vector (.+?)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
LINE = re.compile(r"^([0-9a-f]*(?:00\*(\d+))?)(?: +(.*))?$")


def parse(body: str) -> tuple[bytes, list[tuple[list[int], str, bytes, str]]]:
    """The datagram, and for each element (place, name, its bytes, what is said of it)."""
    elements: list[tuple[list[int], str, bytes, str]] = []
    for one in body.splitlines():
        found = LINE.match(one)
        assert found, one
        digits, zeros, label = found.groups()
        raw = bytes.fromhex(digits.partition("00*")[0] if zeros else digits) + bytes(int(zeros or 0))
        if label is None:  # more bytes of the element above
            place, name, before, said = elements[-1]
            elements[-1] = (place, name, before + raw, said)
        else:
            head, _, said = label.partition(" = ") if " = " in label else label.partition(": ")
            where, _, name = head.partition(" ")
            place = [int(step) for step in where.split(".")] if where[0].isdigit() else []
            elements.append((place, name, raw, said if " = " in label else f": {said}"))
    return b"".join(raw for _, _, raw, _ in elements), elements


VECTORS = {name: parse(body) for name, body in VECTOR.findall(SPEC)}


def header(length: int) -> bytes:
    """The shortest header of a MessagePack array."""
    return bytes([0x90 | length]) if length < 16 else b"\xdc" + length.to_bytes(2, "big")


def said(value: Any) -> Any:
    """A value as the page writes it."""
    if isinstance(value, bytes):
        return {"hex": value.hex()} if any(value) else {"zeros": len(value)}
    return value


def test_every_message_has_a_vector() -> None:
    assert sorted({msgpack.unpackb(datagram)[0] for datagram, _ in VECTORS.values()}) == list(range(1, 22))


@pytest.mark.parametrize("name", VECTORS)
def test_the_independent_reader_finds_what_the_page_says(name: str) -> None:
    datagram, elements = VECTORS[name]
    assert f"\n{name[0].upper() + name[1:]}, {len(datagram)} bytes:\n" in SPEC
    whole = msgpack.unpackb(datagram)
    for place, _, raw, text in elements:
        value = whole
        for step in place:
            value = value[step]
        if text.startswith(": "):
            assert raw == header(len(value))
        else:
            assert said(value) == json.loads(text)
            assert msgpack.unpackb(raw) == value


@pytest.mark.parametrize("name", VECTORS)
def test_the_code_reads_the_vector_and_writes_it_back_byte_for_byte(name: str) -> None:
    datagram, elements = VECTORS[name]
    message = decode(datagram)
    assert encode(message) == datagram
    if isinstance(message, messages.Hello):
        assert messages.padded(msgspec.structs.replace(message, padding=b"")) == datagram
    for place, field, _, text in elements:
        if place in ([], [0]) or text.startswith(": "):
            continue
        value: Any = message
        for step in [place[0] - 1, *place[1:]]:
            value = getattr(value, value.__struct_fields__[step])
        plain = msgspec.to_builtins(value, builtin_types=(bytes,))
        assert said(json.loads(json.dumps(plain)) if not isinstance(plain, bytes) else plain) == json.loads(text), field


@pytest.mark.parametrize(("name", "digits", "why"), rows(section("15.2"), "vector"))
def test_other_forms_of_a_message_are_the_same_message(name: str, digits: str, why: str) -> None:
    datagram = bytes.fromhex(digits.strip("`"))
    assert datagram != VECTORS[name][0], why
    assert decode(datagram) == decode(VECTORS[name][0]), why


@pytest.mark.parametrize(("digits", "why"), rows(section("15.3"), "bytes"))
def test_what_is_malformed_is_refused(digits: str, why: str) -> None:
    datagram = bytes.fromhex(digits.strip("`"))
    with pytest.raises(MalformedError):
        raise AssertionError(f"{why}: read as {decode(datagram)}")


def test_a_line_plays_the_vector() -> None:
    sender, receiver = LineSender(1, 2), LineReceiver(1, 1, 1 / 128, concealment="tank")
    table = rows(section("15.4"), "frame")
    assert [int(row[0]) for row in table] == list(range(len(table)))
    for _, wave, first, waves, total, squares, played, counts in table:
        sender.push((float(wave),))
        if first != "-":
            contents = (int(first), tuple(json.loads(waves)), (float(total),), (float(squares),))
            assert sender.contents() == contents
            assert receiver.receive(*contents)
        assert receiver.pop()[0] == pytest.approx(float(played), abs=1e-15)
        count = receiver.count()
        assert [count.sent, count.applied, count.late, count.lost] == [int(number) for number in counts.split()]


# section, the words before the table, what codes it, a vector that has one, where
ARRAYS: list[tuple[str, str, type[msgspec.Struct], str, list[int]]] = [
    *[
        (title, "", getattr(messages, name), next(each for each in VECTORS if each.startswith(name[0].lower() + name[1:])), [])
        for title, name in re.findall(r"^### (3\.\d+ (\w+)) \(tag", SPEC, re.MULTILINE)
    ],
    ("3.4 Welcome", "Settings:", SeatSettings, "welcome", [6]),
    ("3.6 Waves", "Handle:", messages.Handle, "waves from a client", [15]),
    ("3.8 Heartbeat", "Stamp:", messages.Stamp, "heartbeat", [2]),
    ("3.9 Leave", "Client's account:", accounts.ClientAccount, "leave with an account", [3]),
    ("3.10 Farewell", "Seat's account:", accounts.SeatAccount, "farewell", [3]),
    ("3.10 Farewell", "Room's account:", accounts.RoomAccount, "farewell", [4]),
    ("3.17 SetHand", "Hand:", HandChange, "setHand", [4]),
]  # fmt: skip
MAPS: list[tuple[str, type[msgspec.Struct], list[int]]] = [
    ("coupling", Coupling, [6, 6]),
    ("object", Object, [6, 8]),
    ("playout", Playout, [6, 10]),
]


def table_of(title: str, words: str) -> list[list[str]]:
    text = section(title)
    return rows(text.partition(words)[2] if words else text, "place")


@pytest.mark.parametrize(("title", "words", "struct"), [array[:3] for array in ARRAYS])
def test_fields_stand_in_the_places_of_the_page(title: str, words: str, struct: type[msgspec.Struct]) -> None:
    table = table_of(title, words)
    assert [int(row[0]) for row in table] == list(range(len(table)))
    tag = struct.__struct_config__.tag
    fields = struct.__struct_fields__
    assert [row[1] for row in table] == [*(["tag"] if tag else []), *fields]
    if tag:
        assert table[0][3] == str(tag)
        optional = [row[1] for row in table if row[-1].startswith("*optional*")]
        assert optional == list(fields[len(fields) - len(struct.__struct_defaults__) :])


def test_the_small_lists_and_the_maps_have_the_names_of_the_page() -> None:
    leave = section("3.9 Leave")
    small = (
        ("Counts", accounts.LinkCount), ("Percentiles", accounts.Percentiles), ("Ticks", accounts.TickCount),
        ("Playout", accounts.PlayoutAccount), ("Delay", accounts.DelayAccount), ("Device", accounts.DeviceAccount),
        ("Line", accounts.LineAccount), ("Effects", accounts.EffectAccount),
    )  # fmt: skip
    for title, struct in small:
        text = leave.partition(f"{title}: ")[2].partition(".")[0]
        assert re.findall(r"`(\w+)`", text) == list(struct.__struct_fields__)
    welcome = section("3.4 Welcome")
    up = next(row for row in rows(welcome.partition("Settings:")[2], "place") if row[1] == "up")
    assert re.findall(r"`(\w+)`", up[4]) == list(LinkProfile.__struct_fields__)
    keys = rows(welcome, "map")
    for name, struct, _ in MAPS:
        assert [row[1] for row in keys if row[0] == name] == list(struct.__struct_fields__)


def test_an_effect_has_the_keys_and_bounds_of_the_page() -> None:
    table = rows(section("3.18 Effects"), "key")
    assert {name.strip() for row in table for name in row[0].split(",")} == set(effects.Effect.__struct_fields__)
    whole = msgpack.unpackb(VECTORS["effects"][0])
    for names, kind, bound, _ in table:
        for name in names.split(", "):
            old = [0.0] if kind.startswith("list") else None
            for value, allowed in cases(kind, bound, old):
                changed = [*whole[:-1], {**whole[-1], name: value}]
                if allowed:
                    decode(msgpack.packb(changed))
                else:
                    with pytest.raises(MalformedError):
                        decode(msgpack.packb(changed))


def number(text: str) -> float:
    """A number as the tables write it: 2^63 - 1, -10^4, 0.99."""
    base, _, rest = text.partition("^")
    if not rest:
        return int(text) if text.isdigit() else float(text)
    power, _, less = rest.partition(" - ")
    size = int(base.removeprefix("-")) ** int(power) - int(less or 0)
    return -size if base.startswith("-") else size


def cases(kind: str, bound: str, old: Any) -> list[tuple[Any, bool]]:
    """(value, allowed) on both sides of what a table's row says."""
    if kind == "int, or text":
        range_, _, names = bound.partition(", or ")
        return [*cases("int", range_, old), *cases("text", names, old), (1.0, False), (True, False), (None, False)]
    if kind == "real or text":
        range_, _, names = bound.partition(", or ")
        return [*cases("real", range_, old), *cases("text", names, old), (True, False)]
    if kind.endswith(" or nil"):
        return [*cases(kind.removesuffix(" or nil"), bound, old), (None, True)]
    if kind in ("int", "real"):
        low, _, high = (f"-{bound[2:]} to {bound[2:]}" if bound.startswith("+-") else bound).partition("to ")
        bottom, top = number(low.strip(" ,>")), number(high)
        under, over = (1 if kind == "int" else max(1e-6, 1e-3 * abs(end)) for end in (bottom, top))
        lowest = [(bottom, ">" not in low), (bottom - under, False), (bottom + under, True)]
        return [*lowest, (top, True), (top + over, False)]
    if kind == "text" and bound.startswith('"'):
        names = re.findall(r'"(\w+)"', bound)
        return [*((name, True) for name in names), ("other", False)]
    if kind == "text":
        low, _, high = bound.rpartition(" to ")
        return [("x" * int(high), True), ("x" * (int(high) + 1), False), ("", not low)]
    if kind in ("secret", "token"):
        most = int(bound)
        letters = ("azAZ09-_" if kind == "secret" else "a.AZ09-_") + "x" * (most - 8)
        wrong = ["x" * (most + 1), "x=", *["x.x"] * (kind == "secret"), "x x", "x\n", "é", 7, b"x", None]
        return [(letters, True), ("", True), *((value, False) for value in wrong)]
    if kind == "bool":
        return [(True, True), (False, True), (1, False), (None, False)]
    lengths = re.fullmatch(r"list of (\d+) to (\d+) (reals|ints|texts)", kind)
    if lengths:
        short, long = int(lengths[1]), int(lengths[2])
        one, some = [old[0]], max(1, short)
        sizes = [(one * short, True), (one * long, True), (one * (long + 1), False)]
        sizes += [(one * (short - 1), False)] if short else []
        return sizes + [([value] * some, allowed) for value, allowed in cases(lengths[3][:-1], bound, None)]
    return []


def rows_with_bounds() -> list[tuple[str, list[Any], str, str]]:
    """(vector, place, type, bound) of every row that bounds a value."""
    found: list[tuple[str, list[Any], str, str]] = []
    for title, words, _, vector, path in ARRAYS:
        if "account" not in words:
            table = [row for row in table_of(title, words) if row[1] != "tag"]
            found += [(vector, [*path, int(row[0])], row[2], row[3]) for row in table]
    paths = {name: path for name, _, path in MAPS}
    found += [("welcome", [*paths[row[0]], row[1]], row[2], row[3]) for row in rows(section("3.4 Welcome"), "map")]
    return [row for row in found if row[2] == "bool" or (row[3] and row[2] != "bytes")]


def with_value(name: str, place: list[Any], value: Any) -> bytes:
    whole = msgpack.unpackb(VECTORS[name][0])
    inner = whole
    for step in place[:-1]:
        inner = inner[step]
    inner[place[-1]] = value
    if name == "hello" and place != [18]:  # its padding leaves room for a longer text
        whole[18] = b""
    if place[-1] == "grip_impedance_nspm":  # of a seat of 4 axes alone
        whole[6][8]["axes"] = 4
        del whole[6][6]["rotational_impedance_nms"]
    return bytes(msgpack.packb(whole))


@pytest.mark.parametrize(("name", "place", "kind", "bound"), rows_with_bounds())
def test_both_sides_of_every_bound_of_the_page(name: str, place: list[Any], kind: str, bound: str) -> None:
    old = msgpack.unpackb(VECTORS[name][0])
    for step in place[:-1]:
        old = old[step]
    old = old.get(place[-1], 1.0) if isinstance(old, dict) else old[place[-1]]  # a key that not every seat has
    tried = cases(kind, bound, old)
    assert tried
    for value, allowed in tried:
        datagram = with_value(name, place, value)
        if allowed:
            decode(datagram)
        else:
            with pytest.raises(MalformedError):
                decode(datagram)


@pytest.mark.parametrize("name", VECTORS)
def test_what_may_be_left_out_may_and_then_means_what_the_page_says(name: str) -> None:
    """Optional elements are the last ones of a message."""
    title = next(title for title, words, _, vector, _ in ARRAYS if name.startswith(vector.split()[0]) and not words)
    table = table_of(title, "")
    least = len([row for row in table if not row[-1].startswith("*optional*")])
    whole = msgpack.unpackb(VECTORS[name][0])
    for length in range(least, len(whole)):
        decode(msgpack.packb(whole[:length]))
    with pytest.raises(MalformedError):
        decode(msgpack.packb(whole[: least - 1]))


def test_a_hello_without_what_is_optional_is_a_players() -> None:
    table = table_of("3.3 Hello", "")
    least = len([row for row in table if not row[-1].startswith("*optional*")])
    hello = decode(msgpack.packb(msgpack.unpackb(VECTORS["hello"][0])[:least]))
    assert isinstance(hello, messages.Hello)
    assert (hello.role, hello.token, hello.ticket, hello.padding) == ("player", "", "", b"")
    assert VECTORS["hello"][0].startswith(b"\xdc\x00\x13" + unencrypted_channel.HELLO_BEGINS)
    assert unencrypted_channel.HELLO_BEGINS.hex(" ") == "01 a6 63 6f 67 72 69 70"
    assert unencrypted_channel.HELLO_BEGINS.hex(" ") in SPEC.replace("\n", " ")


@pytest.mark.parametrize(("words", "table"), [("Client:", session.CLIENT), ("Seat, at the server:", session.SEAT)])
def test_states_are_those_of_the_page(words: str, table: session.Table) -> None:
    found = rows(section("4.2").partition(words)[2], "state")
    assert {(state, event): after for state, event, after in found} == dict(table)


PLAYS, LOOKS, GONE = "p" * 22, "o" * 22, "g" * 22


def test_refusal_codes_are_those_of_the_page(tmp_path: Path) -> None:
    """Every way to be refused, tried on an encrypted server with one room of one seat; both sides get code and reason."""
    settings = resolve({"name": "lab", "object": {"axes": 2}, "admission": {"force_n": 9.0, "observers": 1}})
    book, _ = TokenBook().new(PLAYS, 0.0)
    book, _ = book.new(LOOKS, 0.0, role="observer")
    book, gone = book.new(GONE, 0.0)
    book = book.revoke(gone.id, 1.0)
    tokens: Any = SimpleNamespace(
        admit=lambda hello: book.admit(hello.token, hello.role, hello.room, 2.0), admitted=lambda grant: None,
        shown=lambda hello: book.shown(hello.token, 2.0),
    )  # fmt: skip
    core = ServerCore([settings], "1", AdmissionServices(lambda: 1, tokens, lambda: "ticket", "hash of {}".format))
    fit = session.make_hello(
        software="1", nonce=1, room="lab", name="anna", digest="", device="sim:x", axes=2, rate_hz=1024.0, token=PLAYS,
        force_n=8.0,
    )  # fmt: skip
    wrong: list[tuple[dict[str, Any], str]] = [
        ({"version": 3}, "version"), ({"token": ""}, "token"), ({"token": GONE}, "token"), ({"token": LOOKS}, ""),
        ({"room": "attic"}, "room"), ({"name": "eve"}, "name"), ({"digest": "x"}, "settings"), ({"device_axes": 1}, "axes"),
        ({"device_rate_hz": 1.0}, "rate"), ({"device_force_n": 9.1}, "device"), ({"role": "observer"}, "full"), ({}, ""),
        ({}, "taken"), ({"name": ""}, "full"), ({"ticket": "ticket", "device_force_n": 7.0}, "device"),
    ]  # fmt: skip
    channel = DtlsListener(tmp_path, RateLimiter(b"s" * 16), core.knows)
    channel.receive(messages.padded(fit), ("10.0.0.1", 1), 0)
    answers = [(channel.outbox.popleft()[1], "sealed")]
    for number, (change, code) in enumerate(wrong):
        core.receive(messages.padded(msgspec.structs.replace(fit, **change)), number, 0)
        answers.append((core.outbox.popleft()[1], code))
    seen, roles = set(), []
    for answer, code in answers:
        assert len(answer) <= messages.HELLO_BYTES
        called = ClientSession(fit)
        called.connect(0)
        called.receive(answer, 0)
        assert (f"[{code}]" in called.failed) if code else called.state == "seated"
        seen |= {code} - {""}
        roles += [called.welcome.role] if called.welcome else []
    assert roles == ["observer", "player"]  # by the observer's token, by the player's
    assert sorted(seen) == sorted(row[0] for row in rows(section("4.3"), "code"))
    assert set(core.dropped) == {f"refused: {code}" for code in seen - {"sealed"}}


PROTOCOL = (
    "client.coupling.passivity_control", "protocol.laws.passivity_control", "protocol.line.concealment",
    "protocol.line.jitter_buffer", "protocol.line.loop_meter", "protocol.line.receiver", "protocol.settings.effects",
    "protocol.settings.line_tuning", "protocol.settings.sections", "protocol.settings.types", "protocol.wire.clock",
    "protocol.wire.handle", "protocol.wire.messages", "protocol.wire.session", "server.ports.seat_limits", "server.room",
    "server.seats.drawn_bodies", "server.seats.observers",
)  # fmt: skip
DTLS = (
    "client.path_migration", "protocol.secure.dtls_records", "protocol.io.dtls_client", "server.io.dtls_channel",
    "server.io.dtls_peer", "server.rate_limit",
)  # fmt: skip


@pytest.mark.parametrize(
    ("holders", "name", "value", "unit"),
    [(holders, *row) for title, holders in (("10.", PROTOCOL), ("11.5", DTLS)) for row in rows(section(title), "name")],
)
def test_limits_are_those_of_the_page(holders: tuple[str, ...], name: str, value: str, unit: str) -> None:
    modules = [import_module(f"cogrip.{each}") for each in holders]
    held = [getattr(module, name) for module in modules if hasattr(module, name)]
    assert held
    said = [float(part) for part in value.split(",")]
    assert all((list(each) if isinstance(each, tuple) else [each]) == said for each in held)
    assert name.endswith(f"_{unit.upper()}") or unit not in ("ns", "s", "bytes")


def test_nobody_is_answered_but_as_the_page_says(tmp_path: Path) -> None:
    """Try the table of section 11.3, row by row."""
    assert len(rows(section("11.3"), "to")) == 4
    hello, unknown = VECTORS["hello"][0], ("192.0.2.1", 9)
    encrypted = DtlsListener(tmp_path, RateLimiter(b"s" * 16), lambda _: False)
    assert encrypted.receive(hello, unknown, 0) == ()
    (_, answer) = encrypted.outbox.popleft()
    refuse = decode(answer)
    assert isinstance(refuse, messages.Refuse)
    assert (refuse.code, refuse.nonce) == ("sealed", 42)
    others = [datagram for datagram, _ in VECTORS.values() if datagram is not hello]
    for datagram in others:
        assert encrypted.receive(datagram, unknown, 0) == ()
    assert not encrypted.outbox
    assert encrypted.dropped == {"refused: not encrypted": 1, "unauthenticated": len(others)}
    call = DtlsClient(encrypted.fingerprint)
    call.poll(0)
    (_, first) = call.outbox.popleft()
    unencrypted = UnencryptedListener(RateLimiter(b"s" * 16), lambda _: False)
    assert unencrypted.receive(first, unknown, 0) == ()
    assert (unencrypted.dropped, list(unencrypted.outbox)) == ({"unauthenticated": 1}, [])
    for datagram, _ in VECTORS.values():
        assert call.receive(datagram, PEER, 0) == ()
    assert call.dropped == {"not encrypted": len(VECTORS)}
    assert not call.failed
    assert not call.outbox
