"""`cogrip token` and `cogrip kick` as their users type them: links, lists, revocations, and requests to a running server."""

import csv
import json
import re
import shlex
import time
from collections.abc import Iterator
from datetime import datetime
from pathlib import Path
from typing import Any

import msgspec
import pytest

from cogrip.cli.admin.token_new import expiry
from cogrip.cli.terminal.problem import BadInput
from cogrip.protocol.wire.join_link import JoinLink, parse_link
from cogrip.server.administration.orders import KickOrder, ReloadOrder
from cogrip.server.admission.admission import Grant
from cogrip.server.admission.tokens import Token
from cogrip.server.io import control as control_module
from cogrip.server.io.control import Control
from cogrip.server.io.state_folder import ServerRecord, StateFolder, make_folder, write_private, write_server
from cogrip.server.io.token_file import TokenFile

from tests.cli.answering_server import answering
from tests.cli.command import Cogrip

PORT = 47811
SERVER = ServerRecord("lab.example", PORT, "ab" * 32, {"demo": ["anna", "ben"], "wall": ["carl"]}, 1)


@pytest.fixture(autouse=True)
def elsewhere(empty_folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Read and write nothing of this user."""
    monkeypatch.setenv("XDG_STATE_HOME", str(empty_folder / "xdg"))
    monkeypatch.delenv("STATE_DIRECTORY", raising=False)


@pytest.fixture
def folder(tmp_path: Path) -> StateFolder:
    """The state of an encrypted server that ran at PORT."""
    folder = make_folder(tmp_path / "xdg" / "cogrip" / str(PORT))
    write_server(folder, SERVER)
    return folder


@pytest.fixture
def token(cogrip: Cogrip) -> Cogrip:
    """`cogrip token ... --port PORT`."""
    return cogrip.within("token", after=("--port", PORT))


@pytest.fixture
def serving(folder: StateFolder) -> Iterator[list[KickOrder | ReloadOrder]]:
    """A server that answers the commands; gives what it was asked."""

    def answer(order: KickOrder | ReloadOrder) -> dict[str, Any]:
        known = not (isinstance(order, KickOrder) and order.user == "nobody")
        return {"text": f"done: {type(order).__name__}", "ok": known}

    with answering(folder, answer) as orders:
        yield orders


def only_token(folder: StateFolder) -> Token:
    (token,) = TokenFile(folder).load().tokens
    return token


def new(token: Cogrip, *arguments: object) -> tuple[JoinLink, str]:
    """A link, and its id."""
    out, err = token.texts("new", *arguments)
    return parse_link(out), re.match(r"token ([0-9a-f]{8}): ", err)[1]  # type: ignore[index]


# --- new --------------------------------------------------------------------------------------------------------------


def test_the_link_stands_alone_on_standard_output(token, folder) -> None:
    out, err = token.texts("new", "--room", "demo", "--name", "anna", "--once", "--device", "hid:", "--note", "for A.")
    assert out.count("\n") == 1
    link = parse_link(out)
    assert (link.host, link.port, link.room, link.fingerprint) == ("lab.example", PORT, "demo", SERVER.fingerprint)
    made = only_token(folder)
    assert err == f"token {made.id}: player, room demo, seat anna, device hid:, one time\n"
    assert link.token not in err
    assert (made.room, made.user, made.device, made.once, made.note) == ("demo", "anna", "hid:", True, "for A.")
    book = TokenFile(folder).load()
    assert book.admit(link.token, "player", "demo", time.time()) == Grant("player", made.id, "demo", "anna", "hid:")
    assert new(token, "--role", "observer")[0].room == ""


@pytest.mark.parametrize(
    ("host", "place"),
    [("192.0.2.7", ("192.0.2.7", PORT)), ("other:9", ("other", 9)), ("[::1]:9", ("::1", 9)), ("[::1]", ("::1", PORT))],
)
def test_another_address_of_the_server(token, folder, host, place) -> None:
    link, _ = new(token, "--host", host)
    assert (link.host, link.port) == place


def test_as_json(token, folder) -> None:
    out, err = token.texts("new", "--expires", "2h", "--json", "-")
    assert err == ""
    answer = json.loads(out)
    made = only_token(folder)
    assert answer["id"] == made.id
    assert parse_link(answer["link"]).fingerprint == SERVER.fingerprint
    assert answer["expires_s"] == made.expires
    assert made.expires is not None
    assert 7190 <= made.expires - made.created <= 7200


REFUSED = {
    "--room dmo": "--room 'dmo': the server has no such room; did you mean 'demo'?",
    "--room xyz": "--room 'xyz': the server has no such room; there is: demo, wall",
    "--name bne": "--name 'bne': the server has no such seat; did you mean 'ben'?",
    "--room wall --name anna": "--name 'anna': the server has no such seat; there is: carl",
    "--role observer --name anna": "an observer has neither seat nor device",
    "--role king": "king",
    f"--device {'d' * 201}": "--device has 201 characters, more than 200",
    f"--note {'n' * 5000}": "--note has 5000 characters, more than 200",
    "--note 'two\nlines'": "--note holds a line break or control character; leave it out",
    "--device hid:ä": "device: ",
    "--host 'a b'": "--host: host 'a b': write a name",
    "--expires soon": "--expires 'soon': write 30m, 2h, 3d, 1w, a time such as 2026-12-24T18:00, or a day",
    "--expires 2001-01-01": "that is past",
    "--json file.json": "have it on standard output",
}


@pytest.mark.parametrize("arguments", REFUSED, ids=lambda words: words[:30])
def test_what_cannot_be_is_refused_and_makes_no_token(token, folder, arguments) -> None:
    assert REFUSED[arguments] in token.err("new", *shlex.split(arguments))
    assert not folder.tokens.exists()
    assert not Path("file.json").exists()


KNOWN = ["", "h", "hid", "hid:", "hid:wooden", "sim:phantom?hand=hold"]
UNKNOWN = {"hdi:wooden": "did you mean 'hid'?", "hi:": "did you mean 'hid'?", "xyzzy": "there is: emulated, "}


@pytest.mark.parametrize("device", [*KNOWN, *UNKNOWN])
def test_a_device_of_no_family_is_taken_with_a_warning(token, folder, device) -> None:
    out, err = token.texts("new", "--device", device)
    assert (f"warning: --device {device!r}: no device family here is called" in err) == (device in UNKNOWN)
    assert UNKNOWN.get(device, "") in err
    assert parse_link(out)
    assert only_token(folder).device == device


def test_a_link_needs_an_encrypted_server_and_its_address(cogrip, token, folder) -> None:
    write_server(folder, msgspec.structs.replace(SERVER, host="0.0.0.0"))
    err = token.err("new")
    assert "name the one for the link: --host NAME" in err
    assert token("new", "--host", "lab")[0] == 0
    write_server(folder, msgspec.structs.replace(SERVER, fingerprint=""))
    err = token.err("new")
    assert "the server is unencrypted, and asks nobody for a token" in err
    folder.server.unlink()
    err = token.err("new")
    assert "no server has been started here" in err
    err = cogrip.err("token", "new", "--port", PORT + 1)
    assert "there is no such folder; name that of your server by --state or --port" in err
    assert "--port 0 is outside 1 to 65535" in cogrip.err("token", "new", "--port", 0)


def test_the_state_is_where_a_flag_or_the_environment_says(cogrip, folder, monkeypatch) -> None:
    cogrip.texts("token", "new", "--state", folder.path)
    monkeypatch.setenv("STATE_DIRECTORY", str(folder.path))
    assert len(cogrip.answer("token", "list")["tokens"]) == 1


NOW_S = 1_800_000_000.25


def test_an_end_after_some_time_at_a_date_or_with_a_day() -> None:
    def midnight(*day: int) -> int:
        return int(datetime(*day).astimezone().timestamp())  # type: ignore[arg-type]

    for text, seconds in {"1s": 1, "90m": 5400, "2H": 7200, "2 h": 7200, "3d": 259_200, " 1w ": 604_800}.items():
        assert expiry(text, NOW_S) == 1_800_000_000 + seconds

    assert expiry("2027-12-24T18:00", NOW_S) == midnight(2027, 12, 24, 18)
    assert expiry("2027-12-24T18:00:00Z", NOW_S) == 1_829_671_200
    assert expiry("2027-12-24T18:00+02:00", NOW_S) == 1_829_671_200 - 7200
    assert expiry("2027-01-15T08:00:01Z", NOW_S) == 1_800_000_001
    assert expiry("2027-12-24", NOW_S) == midnight(2027, 12, 25)
    assert expiry("2027-12-31", NOW_S) == midnight(2028, 1, 1)
    end_s = midnight(2027, 12, 25)
    assert expiry("2027-12-24", end_s - 1) == end_s, "good to its last second"
    with pytest.raises(BadInput, match="that is past"):
        expiry("2027-12-24", end_s)
    none = "9999-12-31, 1M, 2  h, 0s, -1h, 2027-01-15T08:00:00Z, 4000d, 999999999w, 1e3s, ٣h, , 9999-12-31T23:59:59-12:00, 1.5h"
    for text in none.split(", "):
        with pytest.raises(BadInput, match="--expires"):
            expiry(text, NOW_S)


# --- list -------------------------------------------------------------------------------------------------------------


def test_the_list_shows_what_became_of_each_and_no_secret(cogrip, token, folder) -> None:
    links = [new(token, *arguments) for arguments in (
        ["--room", "demo", "--name", "anna", "--note", "for [bold]A."],
        ["--once"],
        ["--expires", "1h"],
        ["--role", "observer"],
        ["--expires", "3d"],
    )]  # fmt: skip
    ids = [ident for _, ident in links]
    file = TokenFile(folder)
    file.change(lambda book: (book.use(ids[1], 1_800_000_000).revoke(ids[3], 1_800_000_000), None))
    text = folder.tokens.read_text()
    write_private(folder.tokens, re.sub(r'"expires":\d+', '"expires":1000000000', text, count=1).encode())
    out = token.out("list")
    heading, *rows = out.splitlines()
    assert heading.split() == ["id", "role", "room", "seat", "good", "for", "state", "when", "note"]
    assert [row.split()[0] for row in rows] == ids
    expected = (
        ["player", "demo", "anna", "standing", "good", "since", "for [bold]A."],
        ["player", "any", "one time", "used", "at 2027-01-15 08:00 UTC"],
        ["expired", "at 2001-09-09 01:46 UTC"],
        ["observer", "any", "-", "revoked", "at 2027-01-15 08:00 UTC"],
        ["good", "until 20"],
    )
    for row, words in zip(rows, expected, strict=True):
        assert [word for word in words if word not in row] == []
    answer = token.out("list", "--json", "-")
    listed = json.loads(answer)["tokens"]
    assert [each["id"] for each in listed] == ids
    assert [each["state"] for each in listed] == ["good", "used", "expired", "revoked", "good"]
    for shown in (out, answer):
        for secret in [link.token for link, _ in links] + [each.hash for each in file.load().tokens]:
            assert secret not in shown
    assert [row for row in listed[1] if row.endswith("_s")] == ["created_s", "expires_s", "used_s", "revoked_s"]
    assert (listed[1]["used_s"], listed[3]["revoked_s"]) == (1_800_000_000, 1_800_000_000)
    assert cogrip("token", "--port", PORT)[1] == out, "a list is what is meant by `token` alone"


@pytest.mark.parametrize("terminal", [False, True])
def test_a_list_is_whole_in_a_narrow_terminal(token, folder, monkeypatch, terminal) -> None:
    """The id stands first, in every table, and can be copied; the note is last, and breaks between words."""
    note = "for A. in the long room at the end of the corridor"
    _, one = new(token, "--room", "demo", "--note", note)
    monkeypatch.setenv("COLUMNS", "60")
    if terminal:
        monkeypatch.setenv("FORCE_COLOR", "1")
        monkeypatch.setenv("TERM", "xterm-256color")
    out = token.out("list")
    assert ("\x1b[" in out) == terminal
    heading, row, *others = re.sub(r"\x1b\[[0-9;]*m", "", out).splitlines()
    assert heading.split() == ["id", "role", "state", "good", "for", "when"]
    assert row.startswith(f"{one}  player  good   standing  since ")
    assert [line.split()[0] for line in others if not line.startswith(" ")] == ["id", one, "id", one]
    assert " ".join(" ".join(others).split()).endswith(f"id note {one} {note}")
    assert all(len(line.rstrip()) <= 60 for line in (heading, row, *others))


def test_columns_that_say_nothing_are_left_out(token, folder) -> None:
    new(token, "--role", "observer")
    assert token.out("list").splitlines()[0].split() == ["id", "role", "good", "for", "state", "when"]
    new(token, "--device", "hid:")
    assert "device" in token.out("list").splitlines()[0]


def test_an_empty_list(token, folder) -> None:
    assert token("list") == (0, "", f"no tokens in {folder.path}\n")
    write_server(folder, msgspec.structs.replace(SERVER, fingerprint=""))
    note = f"note: the server with the state in {folder.path} is unencrypted, and asks nobody for a token\n"
    assert token("list") == (0, "", f"{note}no tokens in {folder.path}\n")


@pytest.mark.parametrize("command", [["list"], ["new"], ["revoke", "00000000"]])
def test_a_file_that_cannot_be_trusted_is_a_problem(token, folder, command) -> None:
    write_private(folder.tokens, b"{")
    err = token.err(*command, code=1)
    assert "put back a good copy" in err
    assert folder.tokens.read_bytes() == b"{"
    folder.path.chmod(0o755)
    assert "chmod 700" in token.err(*command, code=1)


# --- revoke -----------------------------------------------------------------------------------------------------------


def test_revoked_with_no_server_running(token, folder) -> None:
    (_, one), (_, two) = new(token), new(token)
    near = one[:-1] + ("0" if one[-1] != "0" else "1")
    assert f"no token has the id {near}; did you mean {one}? (nothing was changed)" in token.err("revoke", one, near)
    assert all(each.revoked is None for each in TokenFile(folder).load().tokens)
    out = token.out("revoke", one, two.upper())
    assert out == f"{one} is revoked\n{two} is revoked\nno server is running there: it will read this at its start\n"
    assert all(each.revoked is not None for each in TokenFile(folder).load().tokens)
    assert token.out("revoke", one).startswith(f"{one} was revoked before\n")


def test_a_running_server_is_told(token, folder, serving) -> None:
    _, one = new(token)
    assert token.out("revoke", one) == f"{one} is revoked\nthe server has read it: done: ReloadOrder\n"
    assert serving == [ReloadOrder()]


def test_a_server_that_does_not_answer_is_said(token, folder, monkeypatch) -> None:
    _, one = new(token)
    control = Control(folder)
    ask = control_module.ask
    monkeypatch.setattr("cogrip.cli.admin.token_revoke.ask", lambda folder, order: ask(folder, order, 0.01))
    out, err = token.texts("revoke", one, code=1)
    control.close()
    assert out == f"{one} is revoked\n"
    assert re.search("seats taken with it may last.*did not answer within 0.01 s", err)
    assert only_token(folder).revoked is not None


def test_a_token_in_an_ids_place_is_not_shown(token, folder) -> None:
    link, _ = new(token)
    for given in (link.token, link.text):
        out, err = token.texts("revoke", "--", given, code=2)
        assert "an id has 8 hexadecimal digits" in err
        assert link.token not in out + err
    for given, words in (("abcdef0", "7 characters"), ("abcdef012", "9 characters"), ("abcdefgh", "other characters")):
        err = token.err("revoke", given)
        assert f"an id has 8 hexadecimal digits, as `cogrip token list` shows it; what is given has {words}" in err
    assert "name at least one id" in token.err("revoke")


# --- kick -------------------------------------------------------------------------------------------------------------


def test_a_kick_is_handed_on_whole(cogrip, serving) -> None:
    assert cogrip.out(f"kick anna --room demo --reason lunch --revoke --port {PORT}") == "done: KickOrder\n"
    assert serving == [KickOrder("anna", "demo", "lunch", True)]
    cogrip("kick", "an observer", "--port", PORT)
    assert serving[1:] == [KickOrder("an observer")], "of observers only the server knows"
    assert cogrip("kick", "nobody", "--port", PORT) == (1, "", "cogrip: kick: done: KickOrder\n"), "the server refuses"


def test_a_kick_that_cannot_be(cogrip, serving) -> None:
    for arguments, words in {
        "anna --room dmo": "--room 'dmo': the server has no such room; did you mean 'demo'?",
        "''": "name somebody",
        "a" * 41: "user has 41 characters, more than 40",
        "anna --reason 'a\nb'": "--reason holds a line break or control character; leave it out",
        f"anna --reason {'r' * 201}": "--reason has 201 characters, more than 200",
    }.items():
        assert words in cogrip.err(f"kick {arguments} --port {PORT}")
    assert serving == []


def test_many_are_made_at_once_or_none(token, folder) -> None:
    """Thirty for a class, as a table that a spreadsheet reads; each admits to what it says."""
    text = token.texts("new", "--room", "demo", "--count", "30", "--csv", "--note", "course, group 1")[0]
    rows = list(csv.DictReader(text.splitlines()))
    kept = TokenFile(folder).load()
    assert [row["id"] for row in rows] == [each.id for each in kept.tokens]
    assert len({row["link"] for row in rows}) == 30
    for row in rows:
        assert (row["room"], row["note"], row["once"]) == ("demo", "course, group 1", "False")
        assert isinstance(kept.admit(parse_link(row["link"]).token, "player", "demo", time.time()), Grant)
    error = token.err("new", "--room", "demo", "--count", "371", code=2)
    assert "token new: there are 400 tokens for room demo, and at most 400 are kept; revoke some first" in error
    assert TokenFile(folder).load() == kept
    assert "--count 401 is outside 1 to 400" in token.err("new", "--count", "401")
    assert "--csv and --json exclude each other" in token.err("new", "--csv", "--json", "-")
