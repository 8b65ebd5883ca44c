"""Signed tokens at real servers: minted by the example program, keys that change while the server runs, and their end.

Each refusal is read on both sides, the resumption of a seat after a kill of the server as well.
"""

import re
import signal
import sys
import time
from collections.abc import Callable, Iterator

import pytest

from cogrip.protocol.wire.join_link import JoinLink, parse_link

from tests.live.held_arms import Spoken, fairly
from tests.live.test_unauthenticated_peers import PULL, Server, join
from tests.live.test_workers import Rooms
from tests.live.university import University

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="reads what Linux says of addresses and processes")

LIMIT_S = 60.0
__all__ = ["join"]  # a fixture


def earlier(seconds: float) -> str:
    """Return code that sets a program's clock back."""
    return f"import time; now = time.time; time.time = lambda: now() - {seconds}"


@pytest.fixture(scope="module")
def server(tmp_path_factory) -> Iterator[Server]:
    made = Server(tmp_path_factory.mktemp("signed"), "--encrypted", "--no-links")
    yield made
    made.process.stop()


@pytest.fixture
def ask(start, server) -> Callable[..., str]:
    """Return what an administrator's command at the server says."""

    def asked(*words: object, code: int = 0) -> str:
        process: Spoken = start(*words, "--state", str(server.state))
        assert process.end() == code, process.said
        return process.said

    return asked


@pytest.fixture
def place(ask) -> JoinLink:
    """A link to the server, with a stored token."""
    return parse_link(ask("token", "new", "--room", "demo").split("\n")[-2])


def refused(server: Server, person: Spoken, words: str) -> None:
    assert person.end() == 1, person.said
    assert words in person.said
    assert "[token]" in person.said
    server.process.rewind()
    server.process.hear(words)


@fairly
def test_a_key_is_known_at_once_and_a_revoked_token_ends_who_came_in_by_it(start, server, ask, place, join, tmp_path):
    university = University(tmp_path, "uni")
    anna, jti = university.mint(place, "--seat", "anna")
    ben, _ = university.mint(place, "--seat", "ben", "--once")
    refused(server, join(anna, *PULL), "this token is")  # of an unknown key, or a signed one where there are no keys
    assert "the server has read it" in ask("token", "keys", "add", university.public, "--kid", university.kid)
    first, second = join(anna, *PULL), join(ben, *PULL)
    first.hear("anna holds cube")
    second.hear("ben holds cube")
    assert f"{jti}  good   anna" in ask("token", "list")
    refused(server, join(ben, *PULL), "this token was used already: it is good for one time")
    assert f"{jti} is revoked" in ask("token", "revoke", jti)
    assert first.end() == 1
    assert "kicked: the token was revoked" in first.said
    refused(server, join(anna, *PULL), "this token was revoked")
    assert second.popen.poll() is None, "ben came by another one"
    assert f"key {university.kid} is removed" in ask("token", "keys", "remove", university.kid)
    assert second.end() == 1
    assert "kicked: the token was revoked" in second.said
    assert not any(each.rpartition("#")[2] in server.said for each in (anna, ben))


@fairly
def test_tokens_whose_time_is_not_now_or_too_long_are_refused_and_a_next_key_follows(
    start, server, ask, place, join, tmp_path
):
    one, two = University(tmp_path, "one"), University(tmp_path, "two")
    ask("token", "keys", "add", one.public, "--kid", one.kid)
    good, _ = one.mint(place, code=earlier(3600.0 - 10))  # within its three hours
    late, _ = one.mint(place, "--seconds", "60", code=earlier(100.0))
    early, _ = one.mint(place, code=earlier(-100.0))
    person = join(good, "--name", "anna", *PULL)
    person.hear("anna holds cube")
    refused(server, join(late, *PULL), "this token has expired, at 20")
    refused(server, join(early, *PULL), "this token is good from 20")
    ask("token", "keys", "add", two.public, "--kid", two.kid)
    watches, jti = two.mint(place, "--role", "observer")
    watcher = join(watches)
    watcher.hear("object at")
    ask("token", "keys", "remove", two.kid)
    assert watcher.end() == 1
    assert person.popen.poll() is None, "her key is still there"
    person.popen.send_signal(signal.SIGINT)
    assert person.end() == 0, person.said
    assert jti not in ask("token", "list")


@fairly
def test_a_seat_is_resumed_by_its_signed_token_after_a_kill_of_the_server(start, server, ask, place, join, tmp_path):
    university = University(tmp_path, "resumes")
    ask("token", "keys", "add", university.public, "--kid", university.kid)
    link, jti = university.mint(place, "--seat", "anna", "--once")
    anna = join(link, *PULL)
    anna.hear("anna holds cube")
    deadline_s = time.monotonic() + LIMIT_S
    while f"{jti}  used" not in ask("token", "list"):  # the file has it once the writer's thread is done
        assert time.monotonic() < deadline_s
    server.process.stop()
    server.start()
    anna.hear(r"resumed after ([\d.]+) s")
    anna.hear("force ramps in")
    server.process.rewind()
    server.process.hear("demo: anna resumed from")
    refused(server, join(link, *PULL), "this token was used already: it is good for one time")
    ask("token", "revoke", jti)
    assert anna.end() == 1
    assert "kicked: the token was revoked" in anna.said


@fairly
def test_people_of_several_workers_come_and_go_by_signed_tokens(start, tmp_path):
    rooms = Rooms(start, tmp_path, "--encrypted", "--no-links")
    university = University(tmp_path, "uni")
    place = parse_link(rooms.ask("token", "new", "--room", "cellar").split("\n")[-2])
    link, jti = university.mint(place, "--seat", "ben", "--once")
    assert "the server has read it" in rooms.ask("token", "keys", "add", university.public, "--kid", university.kid)
    ben = start("join", link, "--no-report", "--runs", tmp_path / "ben", *PULL)
    ben.hear("ben holds cube in room")
    again = start("join", link, "--no-report", "--runs", tmp_path / "again", *PULL)
    assert again.end() == 1
    assert "this token was used already" in again.said
    listed = rooms.ask("token", "list")
    assert re.search(rf"{jti}  (good|used) +ben ", listed), listed
    assert f"{jti} is revoked" in rooms.ask("token", "revoke", jti)
    assert ben.end() == 1
    assert "kicked: the token was revoked" in ben.said
