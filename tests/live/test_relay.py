"""`cogrip relay` as its users run it: what arrives through it, and whole sessions over it. Real processes, loopback."""

import re
import signal
import socket
from collections import Counter
from collections.abc import Callable, Iterator
from itertools import islice

import msgspec
import pytest

from cogrip.protocol.settings.room import resolve
from cogrip.protocol.wire.join_link import parse_link
from cogrip.results.reading.records import open_run
from cogrip.sim.link import Fate, fates

from tests.extent import long
from tests.free_ports import free_port
from tests.live.held_arms import LIMIT_S
from tests.live.test_live_sessions import DEMO, FEW_FRAMES, HOLD, accounted, leaving, summary_in

MANY = 250
ROOM_BYTES = 1 << 20  # for all of them, while nobody reads
ROUGH = ("delay_ms=5", "jitter_ms=20", "loss=0.2", "burst_frames=3", "duplicate=0.2", "reorder=0.1")
SETS = [part for each in ROUGH for part in ("--set", f"link.{each}")]


@pytest.fixture
def bound() -> Iterator[Callable[..., socket.socket]]:
    made: list[socket.socket] = []

    def make(host: str = "127.0.0.1") -> socket.socket:
        made.append(socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET, socket.SOCK_DGRAM))
        made[-1].setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, ROOM_BYTES)
        made[-1].bind((host, 0))
        made[-1].settimeout(LIMIT_S)
        return made[-1]

    yield make
    for each in made:
        each.close()


def numbers(receiver: socket.socket, count: int) -> list[int]:
    """Return the numbers of so many datagrams, in the order of their arrival."""
    return [int(receiver.recv(2048)) for _ in range(count)]


def check_order(got: list[int], drawn: list[Fate], counted: dict) -> None:
    """Assert that the drawn datagrams came; of two sent in order, the one with no more delay came no later."""
    expected = Counter({n: 1 + (fate.copy_extra_ns is not None) for n, fate in enumerate(drawn) if not fate.lost})
    assert Counter(got) == expected
    # arrivals of number n, first to last: sent in order, so when it left the sender is rising in n, and what it waits is drawn
    places: dict[int, list[int]] = {}
    for place, number in enumerate(got):
        places.setdefault(number, []).append(place)
    waits = {n: sorted({drawn[n].extra_ns, drawn[n].copy_extra_ns or drawn[n].extra_ns}) for n in places}
    for early in places:
        for later in places:
            if early < later and waits[early][-1] <= waits[later][0]:
                assert places[early][-1] < places[later][0], (early, later)
    assert counted["lost"] == sum(fate.lost for fate in drawn)
    assert counted["delivered"] == len(got)
    assert counted["sent"] + counted["duplicated"] == counted["delivered"] + counted["lost"]


def test_what_arrives_is_what_the_laboratorys_links_let_through(relay, bound):
    """Two clients and both directions, at their own pace: loss, copies and order are those that were drawn, by number."""
    server = bound()
    _, place, end = relay(f"127.0.0.1:{server.getsockname()[1]}", "--seed", "7", *SETS)
    link = resolve({}, {f"link.{name}": float(value) for name, value in (each.split("=") for each in ROUGH)}).link
    drawn = {
        (n, direction): list(islice(fates(link.direction(direction), f"7/{n}/{direction}"), MANY))
        for n in range(2)
        for direction in ("up", "down")
    }
    got, directions = {}, {}
    for n in range(2):
        client = bound()
        for number in range(MANY):
            client.sendto(b"%d" % number, place)
        copies = sum((not fate.lost) * (1 + (fate.copy_extra_ns is not None)) for fate in drawn[n, "up"])
        got[n, "up"] = []
        for _ in range(copies):
            datagram, directions[n] = server.recvfrom(2048)
            got[n, "up"].append(int(datagram))
        for number in range(MANY):
            server.sendto(b"%d" % number, directions[n])
        copies = sum((not fate.lost) * (1 + (fate.copy_extra_ns is not None)) for fate in drawn[n, "down"])
        got[n, "down"] = numbers(client, copies)
    assert directions[0] != directions[1], "the server sees distinct addresses"
    summary = end()
    assert [flow["number"] for flow in summary["flows"]] == [0, 1]
    for (n, direction), fates_drawn in drawn.items():
        check_order(got[n, direction], fates_drawn, summary["flows"][n][direction])
        assert summary["flows"][n][direction]["reordered"] > 0
    for direction in ("up", "down"):
        assert summary["late_us"][direction]["p50"] >= 0
        assert summary["totals"][direction]["in_flight"] == summary["totals"][direction]["not_sent"] == 0


def test_nobody_at_the_far_end_is_counted_and_whoever_comes_later_is_reached(relay, bound):
    client, port = bound(), free_port()
    process, place, end = relay(f"127.0.0.1:{port}")
    for number in range(3):
        client.sendto(b"%d" % number, place)
    process.hear("flow 0: ")
    server = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    with server:
        server.bind(("127.0.0.1", port))
        server.settimeout(LIMIT_S)
        client.sendto(b"7", place)
        while int(server.recv(99)) != 7:
            pass
    summary = end()
    assert 1 <= summary["flows"][0]["up"]["refused"] <= 3
    assert summary["flows"][0]["up"]["not_sent"] == 0


def test_clients_beyond_the_bound_get_nothing(relay, bound):
    server, one, other = bound(), bound(), bound()
    process, place, end = relay(f"127.0.0.1:{server.getsockname()[1]}", "--flows", "1")
    one.sendto(b"1", place)
    assert server.recv(99) == b"1"
    other.sendto(b"2", place)
    one.sendto(b"3", place)
    assert server.recv(99) == b"3"
    summary = end()
    assert (summary["beyond_limit"], summary["flows_begun"]) == (1, 1)
    assert "of peers beyond --flows 1" in process.said


@pytest.mark.long
def test_an_idle_flow_ends_and_its_client_may_come_again(relay, bound):
    server, client = bound(), bound()
    process, place, end = relay(f"127.0.0.1:{server.getsockname()[1]}", "--idle-s", "1")
    directions = []
    for _ in range(2):
        client.sendto(b"hello", place)
        directions.append(server.recvfrom(99)[1])
        process.hear(f"flow {len(directions) - 1}: .* was idle for too long")
    server.sendto(b"late", directions[0])
    summary = end()
    assert directions[0] != directions[1]
    assert (summary["flows"], summary["flows_begun"], summary["flows_expired"]) == ([], 2, 2)
    assert summary["totals"]["up"]["delivered"] == 2
    assert summary["totals"]["down"]["sent"] == 0, "nobody has that address any more"


@pytest.mark.skipif(not socket.has_ipv6, reason="no IPv6")
def test_it_speaks_version_6(relay, bound):
    try:
        server, client = bound("::1"), bound("::1")
    except OSError:
        pytest.skip("no IPv6 here")
    _, place, end = relay(f"[::1]:{server.getsockname()[1]}", listen="[::1]:0")
    client.sendto(b"hello", place)
    datagram, direction = server.recvfrom(99)
    server.sendto(datagram + b" yourself", direction)
    assert client.recv(99) == b"hello yourself"
    assert end()["totals"]["down"]["delivered"] == 1


@pytest.mark.parametrize("encrypted", [long(False), True])
def test_two_people_hold_one_cube_over_an_impaired_network(run, relay, tmp_path, encrypted):
    """Encrypted or not: the relay reads nothing of what it carries."""
    seal = ("--encrypted", "--state", tmp_path / "state") if encrypted else ()
    server = run(
        "serve", DEMO, "--port", "0", "--seconds", "600", "--no-report", "--runs", tmp_path / "server", "--set",
        "link.delay_ms=0", "--set", "playout.frames=4", *seal,
    )  # fmt: skip
    port = int(server.hear(r"listening on \S+:(\d+)")[1])
    process, place, end = relay(f"127.0.0.1:{port}", "--profile", "wifi", "--seed", "3")
    where = f"{place[0]}:{place[1]}"
    if encrypted:
        printed = parse_link(re.search(r"as player: .*'(cogrip:\S+)'", server.said)[1])
        where = msgspec.structs.replace(printed, port=place[1]).text
    people = [
        run("join", where, "--name", name, *HOLD, "--seconds", "1.5", *leaving(tmp_path / name))
        for name in ("anna", "ben")
    ]
    assert [person.end() for person in people] == [0, 0], [person.said for person in people]
    server.signal(signal.SIGTERM)
    assert server.end() == 0, server.said
    summary = end()
    whole = summary_in(tmp_path / "server")
    assert whole["passive"]
    for user in whole["users"]:
        assert user["link"]["applied"] > FEW_FRAMES
        assert accounted(user["link"])
    assert summary["flows_begun"] == 2
    for direction in ("up", "down"):
        total = summary["totals"][direction]
        assert total["sent"] + total["duplicated"] == sum(
            total[each] for each in ("delivered", "lost", "outage", "queue_dropped", "in_flight")
        )
        assert total["delivered"] > 2 * FEW_FRAMES
        assert total["reordered"] > 0
        assert total["crowded"] == 0
    assert "relaying from" in process.said


@pytest.mark.long
def test_every_edge_of_a_button_comes_to_the_world_once_through_thirty_percent_loss(run, relay, tmp_path):
    """Two people press at their own times; what the world was given stands in the server's recording."""
    server = run(
        "serve", DEMO, "--port", "0", "--seconds", "600", "--no-report", "--runs", tmp_path / "server", "--set",
        "link.delay_ms=0", "--set", "playout.frames=4",
    )  # fmt: skip
    port = int(server.hear(r"listening on \S+:(\d+)")[1])
    lossy = (
        "--set",
        "link.loss=0.3",
        "--set",
        "link.delay_ms=5",
        "--set",
        "link.duplicate=0.2",
        "--set",
        "link.reorder=0.2",
    )
    _, place, end = relay(f"127.0.0.1:{port}", "--seed", "5", *lossy)
    presses = [(1, 9, 0.2, 0.12), (32, 8, 0.25, 0.13)]  # button, how often, from when, every [s]
    people = []
    for name, (button, count, first_s, every_s) in zip(("anna", "ben"), presses, strict=True):
        press = ",".join(f"{button}@{first_s + n * every_s:.3f}+{0.5 * every_s:.3f}" for n in range(count))
        device = f"sim:phantom?hand=hold&press={press}"
        people.append(run(
            "join", f"{place[0]}:{place[1]}", "--name", name, "--device", device, "--seconds", "1.5", *leaving(tmp_path / name),
        ))  # fmt: skip
    assert [person.end() for person in people] == [0, 0], [person.said for person in people]
    server.signal(signal.SIGTERM)
    assert server.end() == 0, server.said
    lost = end()["totals"]["up"]
    assert 0.2 < lost["lost"] / lost["sent"] < 0.4
    (folder,) = (tmp_path / "server").iterdir()
    steps = [timed.record for timed in open_run(folder).steps()]
    for seat, (button, count, _, _) in enumerate(presses):
        edges = [edge for step in steps for edge in step.seats[seat].edges]
        assert edges == [button, -button] * count
