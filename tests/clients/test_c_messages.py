"""The client in C reads and writes the wire of SPEC.md: its vectors, tables, bounds and links."""

import json
import re
from ctypes import byref, create_string_buffer, sizeof
from pathlib import Path
from typing import Any

import msgpack
import pytest

from cogrip.protocol.wire.messages import PROTOCOL_VERSION, decode, encode

from tests.clients.compiled import (
    CLIENT_BYTES,
    HERE,
    SOURCES,
    CClient,
    Target,
    build,
    has_libssl,
    needs_compiler,
    needs_cxx,
)
from tests.docs.pages import page
from tests.extent import long
from tests.protocol.spec_page import rows, section
from tests.protocol.test_spec_vectors import VECTORS, cases, rows_with_bounds, with_value

pytestmark = needs_compiler

SESSION = 0x1122334455667788
READ = ("welcome", "refuse", "waves", "partner", "heartbeat", "farewell", "effects")
"""Messages to a player, by the beginning of its vector's name."""
TAGS = {name: msgpack.unpackb(datagram)[0] for name, (datagram, _) in VECTORS.items()}
VALUES = {"f": "0123456789abcdef" * 4, "t": "AAECAwQFBgcICQoLDA0ODw"}
SOURCE = (SOURCES / "cogrip.c").read_text(encoding="utf-8")


def fields(library: Any, datagram: bytes) -> dict[str, Any]:
    text = create_string_buffer(4096)
    assert library.probe_decode(datagram, len(datagram)), datagram.hex()
    library.probe_fields(text, len(text))
    return json.loads(text.value)  # type: ignore[no-any-return]


@pytest.mark.parametrize(
    "arguments",
    [
        ("-O0", "-c", "-DCOGRIP_NO_DTLS", "cogrip.c"),
        *map(long, [("-O3", "-c", "-DCOGRIP_NO_DTLS", "cogrip.c"), ("-O2", "-c", "-DCOGRIP_NO_DRIVER", "cogrip.c")]),
    ],
)
def test_it_compiles_without_a_warning(built: Path, arguments: tuple[str, ...]) -> None:
    """Without encryption; the core is compiled for these tests, the whole for those of live sessions."""
    build(built, "some.o", *arguments)


@needs_cxx
@pytest.mark.parametrize("standard", ["c++11", *map(long, ["c++17", "c++20"])])
@pytest.mark.parametrize("switch", ["-DCOGRIP_NO_DTLS", long("-DCOGRIP_NO_DRIVER")])
def test_it_compiles_as_cxx_without_a_warning(built: Path, standard: str, switch: str) -> None:
    build(built, "some.o", f"-std={standard}", "-O0", "-c", switch, "cogrip.c", cxx=True)


@needs_cxx
@pytest.mark.skipif(not has_libssl(), reason="no libssl-dev")
def test_the_whole_compiles_as_cxx_without_a_warning(built: Path) -> None:
    build(built, "whole.o", "-std=c++17", "-O0", "-c", "cogrip.c", cxx=True)


SURROUNDING = """
#include "cogrip.h"
static char memory[COGRIP_DRIVER_BYTES], error[256];
static const char *const target = "127.0.0.1:47800";
static cogrip_config config;
static double position_m[COGRIP_AXES], force_n[COGRIP_AXES];
void wait_ms(int ms);
void read_device(double *into);
void push_hand(const double *force);
void hold(void);
void hold(void) {
%s
}
"""
"""Lines around the tick of docs/c_client.md."""


@pytest.mark.parametrize("cxx", [False, pytest.param(True, marks=needs_cxx)])
def test_the_tick_of_the_page_compiles(built: Path, tmp_path: Path, cxx: bool) -> None:
    (tick,) = re.findall(r"^```c\n(.*?)^```$", page("docs/c_client.md"), re.DOTALL | re.MULTILINE)
    (tmp_path / "tick.c").write_text(SURROUNDING % tick)
    build(built, "tick.o", "-c", tmp_path / "tick.c", cxx=cxx)


def test_lines_are_short() -> None:
    paths = [
        path
        for folder in (SOURCES.parent, HERE)
        for path in folder.rglob("*")
        if path.suffix in (".c", ".h", ".cpp", ".hpp", ".cs")
    ]
    assert len(paths) >= 25
    longest = {path.name: max(map(len, path.read_text(encoding="utf-8").splitlines())) for path in paths}
    assert {name: length for name, length in longest.items() if length > 128} == {}


@pytest.mark.parametrize("name", [name for name in VECTORS if name.startswith(READ)])
def test_it_reads_the_vectors(library: Any, name: str) -> None:
    datagram, elements = VECTORS[name]
    found = fields(library, datagram)
    said = {
        label: json.loads(text)
        for place, label, _, text in elements
        if not text.startswith(": ") and place[0] != 15 and place[:2] != [6, 16]
    }
    shared = [label for label in found if label in said and not isinstance(said[label], list)]
    assert {label: found[label] for label in shared} == {label: said[label] for label in shared}
    assert len(shared) >= (2 if name == "farewell" else 3)
    if TAGS[name] == 4:
        whole = msgpack.unpackb(datagram)
        rows = [whole[3], whole[4][0], whole[5][0], whole[10][1]]
        assert [found[label] for label in ("waves", "total", "squares", "state")] == rows
    if name == "welcome":
        tables = {**said["coupling"], **said["playout"], "axes": 1, "emulated": 1, "player": 1}
        read = found.keys() & tables.keys()
        assert {"kind", "impedance_nspm", "decimator", "frames", "redundancy", "concealment"} < read
        assert {key: found[key] for key in read} == {key: tables[key] for key in read}


@pytest.mark.parametrize("name", VECTORS)
def test_no_vector_is_malformed_and_none_cut_short_is_read(library: Any, name: str) -> None:
    datagram = VECTORS[name][0]
    assert library.probe_decode(datagram, len(datagram)) == TAGS[name]
    for size in range(len(datagram)):
        assert not library.probe_decode(datagram[:size], size), size
    assert not library.probe_decode(datagram + b"\0", len(datagram) + 1)


def test_it_writes_the_hello_of_the_page(library: Any) -> None:
    client = CClient(
        library, room=b"lab", name=b"anna", token=VALUES["t"].encode(), device=b"sim:phantom", software=b"0.1.0", axes=3,
        peak_force_n=8.5, speed_mps=2.0,
    )  # fmt: skip
    client.connect(0)
    assert list(client.sent()) == [(VECTORS["hello"][0], True)]


def test_it_writes_the_other_messages_of_the_page(library: Any) -> None:
    out = create_string_buffer(1195)
    size = library.probe_heartbeat(SESSION, 1_000_000_000, out)
    assert out.raw[:size] == VECTORS["heartbeat"][0]
    for name, with_account in (("leave", 0), ("leave with an account", 1)):
        size = library.probe_leave(SESSION, with_account, out)
        assert out.raw[:size] == VECTORS[name][0]
        assert encode(decode(out.raw[:size])) == out.raw[:size]


@pytest.mark.parametrize(("name", "digits", "why"), rows(section("15.2"), "vector"))
def test_other_forms_of_a_message_are_the_same_message(library: Any, name: str, digits: str, why: str) -> None:
    datagram = bytes.fromhex(digits.strip("`"))
    assert fields(library, datagram) == fields(library, VECTORS[name][0]), why


@pytest.mark.parametrize(("digits", "why"), rows(section("15.3"), "bytes"))
def test_what_is_malformed_is_refused(library: Any, digits: str, why: str) -> None:
    datagram = bytes.fromhex(digits.strip("`"))
    assert not library.probe_decode(datagram, len(datagram)), why


@pytest.mark.parametrize(
    ("name", "place", "kind", "bound"),
    [row for row in rows_with_bounds() if row[0].startswith(READ) and row[1][0] != 0],
)
def test_both_sides_of_every_bound_of_the_page(
    library: Any, name: str, place: list[Any], kind: str, bound: str
) -> None:
    old = msgpack.unpackb(VECTORS[name][0])
    for step in place[:-1]:
        old = old[step]
    old = old.get(place[-1], 1.0) if isinstance(old, dict) else old[place[-1]]  # a key that not every seat has
    for value, allowed in cases(kind, bound, old):
        datagram = with_value(name, place, value)
        if place[-2:] == [6, "kind"] and isinstance(
            value, str
        ):  # it refuses a seat of another kind by name, once it is read
            allowed = 0 < len(value) <= 32
        assert bool(library.probe_decode(datagram, len(datagram))) is allowed, value


@pytest.mark.parametrize("place", [6, 8, 10], ids=["coupling", "object", "playout"])
def test_a_map_with_a_key_too_few_too_many_twice_or_unknown_is_malformed(library: Any, place: int) -> None:
    table = msgpack.unpackb(VECTORS["welcome"][0])[6][place]
    keys = list(table)
    rest = {key: table[key] for key in keys[1:]}
    for value in (rest, {**table, "other": 1}, {"other": 1, **rest}):
        datagram = with_value("welcome", [6, place], value)
        assert not library.probe_decode(datagram, len(datagram)), value
    backwards = with_value("welcome", [6, place], dict(reversed(table.items())))
    assert library.probe_decode(backwards, len(backwards))
    twice = with_value("welcome", [6, place], table)
    name = msgpack.packb(keys[1])
    twice = twice.replace(name, msgpack.packb(keys[0]), 1) if len(keys[0]) == len(keys[1]) else twice[:-1]
    assert not library.probe_decode(twice, len(twice))


def test_limits_are_those_of_the_page(library: Any) -> None:
    """Each name of the table that the source has means the same number there."""
    known = {row[0]: float(row[1]) for row in rows(section("10."), "name")}
    found = dict(re.findall(r"#define (\w+) (\S.*?)(?: */\*.*)?$", SOURCE, re.MULTILINE))
    for body in re.findall(r"^enum \{(.*?)^\}", SOURCE, re.MULTILINE | re.DOTALL):
        found |= re.findall(r"(\w+) = ([^,/]+?),?\s*(?:/\*|$)", body, re.MULTILINE)
    same = {name: float(eval(found[name].replace("MS", "1e6"))) for name in known if name in found}
    assert same == {name: known[name] for name in same}
    assert len(same) >= 28
    header = (SOURCES / "cogrip.h").read_text(encoding="utf-8")
    said = {name: int(value) for name, value in re.findall(r"#define COGRIP_(\w+) +(\d+)", header)}
    assert said["PROTOCOL"] == PROTOCOL_VERSION
    assert said["MESSAGE_BYTES"] == known["MAX_MESSAGE_BYTES"]
    assert said["CLIENT_BYTES"] == CLIENT_BYTES >= library.probe_client_bytes()


def parsed(library: Any, text: str) -> tuple[Target | None, str]:
    target, error = Target(), create_string_buffer(200)
    good = library.cogrip_parse_target(text.encode(), byref(target), sizeof(target), error, 200)
    return (target if good else None), error.value.decode()


def filled(cell: str) -> str:
    link = cell.strip("`")
    return re.sub(
        r"#0?f|\bt\b(?==?$)|(?<=\.)t", lambda found: found[0].replace("f", VALUES["f"]).replace("t", VALUES["t"]), link
    )


@pytest.mark.parametrize(("link", "host", "port", "room", "written"), rows(section("15.5"), "link"))
def test_links_are_read(library: Any, link: str, host: str, port: str, room: str, written: str) -> None:
    target, error = parsed(library, f"  {filled(link)}\n")
    assert target, error
    assert (target.host.decode(), target.port, target.room.decode()) == (host, int(port), room)
    assert (target.fingerprint.decode(), target.token.decode()) == (VALUES["f"], VALUES["t"])


@pytest.mark.parametrize("most", [640, 641])
def test_both_sides_of_the_longest_signed_token(library: Any, most: int) -> None:
    token = "a.b." + "c" * (most - 4)
    target, error = parsed(library, f"cogrip://lab.example/lab#{VALUES['f']}.{token}")
    if most == 641:
        assert (target, error) == (None, "join link: a signed token must have three parts, and at most 640 characters")
        return
    assert target, error
    assert target.token.decode() == token
    client = CClient(library, token=target.token, device=b"x" * 200, name=b"n" * 40, room=b"r" * 40, software=b"s" * 40)
    client.connect(0)
    ((datagram, _),) = client.sent()
    hello = decode(datagram)
    assert hello.token == token
    assert 1024 < len(datagram) <= 1195


@pytest.mark.parametrize(("text", "why"), rows(section("15.5"), "text"))
def test_what_is_no_link_is_refused_and_its_secret_not_shown(library: Any, text: str, why: str) -> None:
    target, error = parsed(library, filled(text))
    assert target is None, why
    assert error
    assert VALUES["f"][:8] not in error
    assert VALUES["t"][:8] not in error


@pytest.mark.parametrize(
    ("text", "host", "port"),
    [
        ("127.0.0.1:5", "127.0.0.1", 5), ("lab.example", "lab.example", 47800), ("[::1]:9", "::1", 9),
        ("[fe80::1%eth0]", "fe80::1%eth0", 47800),
        ("[::ffff:192.0.2.1]:1", "::ffff:192.0.2.1", 1), ("[1:2:3:4:5:6:7:8]", "1:2:3:4:5:6:7:8", 47800),
    ],
)  # fmt: skip
def test_addresses_of_unencrypted_servers_are_read(library: Any, text: str, host: str, port: int) -> None:
    target, error = parsed(library, text)
    assert target, error
    assert (target.host.decode(), target.port, target.fingerprint) == (host, port, b"")


@pytest.mark.parametrize(
    "text",
    ["", ":1", "a:0", "a:65536", "a:1x", "a:", "[::1", "[::1]x", "[a]:1", "::1", "[1:2:3]:1",
     "[1::2::3]:1", "[12345::]:1", "[:1]", "[::1.2.3]",
     "a b", "-a:1", "x" * 254, "[fe80::1%]", "#", "x" * 1001],
)  # fmt: skip
def test_what_is_no_address_is_refused(library: Any, text: str) -> None:
    assert parsed(library, text)[0] is None
