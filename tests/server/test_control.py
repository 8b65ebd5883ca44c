"""A running server and the commands that ask it: real sockets, a server that never waits, and words for all that fails."""

import http.client
import json
import os
import socket
import stat
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, suppress
from typing import Any

import msgspec
import openapi_spec_validator
import pytest

from cogrip.protocol.settings.hand import parsed
from cogrip.protocol.settings.settable import RoomChange
from cogrip.server.administration.connection import MOST_ANSWER_BYTES, MOST_BODY_BYTES, MOST_HEAD_BYTES
from cogrip.server.administration.operations import OPERATIONS, EventFilter, openapi, order_of, request_of
from cogrip.server.administration.orders import (
    CloseRoomOrder,
    KickOrder,
    NewRoomOrder,
    OrderReply,
    ReloadOrder,
    Request,
    SetHandOrder,
    SetRoomOrder,
    StatusOrder,
    WhoOrder,
)
from cogrip.server.events import ServerEvent
from cogrip.server.io.control import (
    ALIVE_NS,
    CALLER_LIMIT_NS,
    LOST,
    MOST_CALLERS,
    MOST_KEPT,
    MOST_PATH_BYTES,
    MOST_STREAMS,
    MOST_UNSENT_BYTES,
    Control,
    ControlError,
    NotRunningError,
    ask,
)
from cogrip.server.io.state_folder import StateFolder, make_folder, write_private

from tests.server.patience import LIMIT_S, until


@pytest.fixture
def folder(tmp_path) -> StateFolder:
    return make_folder(tmp_path / "state")


@pytest.fixture
def control(folder: StateFolder) -> Iterator[Control]:
    control = Control(folder)
    yield control
    control.close()


@pytest.fixture
def people() -> Iterator[ThreadPoolExecutor]:
    with ThreadPoolExecutor(12) as pool:
        yield pool


def next_request(control: Control) -> Request:
    found: list[Request] = []
    until(lambda: found.extend(control.poll()) or found)
    assert len(found) == 1
    return found[0]


def call(folder: StateFolder, said: bytes = b"") -> socket.socket:
    caller = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    caller.settimeout(LIMIT_S)
    caller.connect(os.fspath(folder.control))
    caller.sendall(said)
    return caller


def http_request(method: str, target: str, body: bytes = b"") -> bytes:
    """Return a request as any program may send it."""
    head = f"{method} {target} HTTP/1.1\r\nHost: cogrip\r\nContent-Length: {len(body)}\r\n\r\n"
    return head.encode("ascii") + body


def answered(folder: StateFolder, said: bytes) -> tuple[int, dict[str, Any]]:
    """Return status and value of the answer, read by Python's own HTTP."""
    with call(folder, said) as caller:
        response = http.client.HTTPResponse(caller)
        response.begin()
        return response.status, json.loads(response.read())


@pytest.mark.parametrize(
    "order",
    [KickOrder("anna", "demo", "you pull too hard", True), KickOrder("é" * 40), ReloadOrder(), StatusOrder()],
    ids=str,
)
def test_an_order_comes_as_it_was_given_and_is_answered(
    control: Control, folder: StateFolder, people: ThreadPoolExecutor, order: KickOrder | ReloadOrder | StatusOrder
) -> None:
    for ok in (True, False):
        answer = people.submit(ask, folder, order, LIMIT_S)
        request = next_request(control)
        assert request.order == order
        control.answer(request, OrderReply(ok, "said – done"))
        assert answer.result(LIMIT_S) == OrderReply(ok, "said – done")
    assert control.dropped == {}


def test_only_this_user_may_ask_and_nobody_asking_costs_nothing(control: Control, folder: StateFolder) -> None:
    assert folder.control.stat().st_mode == stat.S_IFSOCK | 0o600
    assert control.poll() == []
    assert control.dropped == {}


def test_the_largest_answer_comes_whole(control: Control, folder: StateFolder, people: ThreadPoolExecutor) -> None:
    fits = MOST_ANSWER_BYTES - len(b'{"ok":true,"text":""}')
    for size, ok in ((fits, True), (fits + 1, False)):
        answer = people.submit(ask, folder, StatusOrder(), LIMIT_S)
        control.answer(next_request(control), OrderReply(True, "x" * size))
        until(lambda answer=answer: control.poll() or answer.done())
        assert answer.result().ok is ok
    assert answer.result().text == f"the answer would have {MOST_ANSWER_BYTES + 1} bytes, too many"


@pytest.mark.parametrize(
    ("said", "reason", "status"),
    [
        (b"\n\n", "malformed", 400),
        (b"hello\n\n", "malformed", 400),
        (b"\xff\xfe\n\n", "malformed", 400),
        (b"GET /v1/status HTTP/1.1\r\n\r\n", "malformed", 400),  # no host
        (b"x" * MOST_HEAD_BYTES + b"\n", "too long", 431),
        (b"x" * (MOST_HEAD_BYTES + 1), "too long", 431),
        (http_request("POST", "/v1/kick", b"x" * (MOST_BODY_BYTES + 1)), "too long", 413),
        (http_request("GET", "/v1/fly"), "unknown", 404),
        (http_request("DELETE", "/v1/people"), "unknown", 405),
        (http_request("GET", "/v1/kick"), "unknown", 405),
        (http_request("POST", "/v1/status"), "unknown", 405),
        (http_request("POST", "/v1/kick", b"["), "malformed", 400),
        (http_request("POST", "/v1/kick", b"[" * 4000), "malformed", 400),
        (http_request("POST", "/v1/kick"), "malformed", 400),
        (http_request("POST", "/v1/kick", b'{"user":7}'), "malformed", 400),
        (http_request("POST", "/v1/kick", b'{"user":"a","usr":"b"}'), "malformed", 400),
        (http_request("POST", "/v1/kick", b'{"verb":"mark","user":"a"}'), "malformed", 400),
        (http_request("POST", "/v1/kick", json.dumps({"user": "a" * 41}).encode()), "malformed", 400),
        (http_request("POST", "/v1/kick", json.dumps({"user": "a", "reason": "r" * 201}).encode()), "malformed", 400),
        (http_request("GET", "/v1/people?rom=lab"), "malformed", 400),
        (http_request("GET", "/v1/people?room"), "malformed", 400),
        (http_request("GET", "/v1/people?room=" + "r" * 41), "malformed", 400),
        (http_request("POST", "/v1/set", b'{"user":"anna"}'), "malformed", 400),
        (http_request("POST", "/v1/set", b'{"user":"anna","values":{}}'), "malformed", 400),
        (http_request("POST", "/v1/set", b'{"user":"anna","values":{"stiffness_npm":-1}}'), "malformed", 400),
        (http_request("POST", "/v1/set", b'{"values":{"stiffness_npm":1}}'), "malformed", 400),
        (http_request("POST", "/v1/set", b'{"values":{"object.mass_kg":1e999}}'), "malformed", 400),
        (http_request("GET", "/v1/metrics"), "", 404),
    ],
)  # fmt: skip
def test_no_order_is_counted_and_answered(
    control: Control, folder: StateFolder, people: ThreadPoolExecutor, said: bytes, reason: str, status: int
) -> None:
    answer = people.submit(answered, folder, said)
    until(lambda: control.poll() or answer.done())
    found, value = answer.result(LIMIT_S)
    assert found == status
    assert control.dropped == ({reason: 1} if reason else {})
    assert value["ok"] is False
    assert value["text"]
    assert control.poll() == []


def test_the_longest_order_is_read_also_in_pieces(control: Control, folder: StateFolder) -> None:
    order = http_request("POST", "/v1/reload", b"{}".ljust(MOST_BODY_BYTES))
    with call(folder, order):
        assert next_request(control).order == ReloadOrder()
    with call(folder, order[:10]) as caller:
        assert control.poll() == []
        assert control.poll() == []
        caller.sendall(order[10:])
        assert next_request(control).order == ReloadOrder()


def test_who_breaks_off_and_who_asks_and_goes_is_counted(control: Control, folder: StateFolder) -> None:
    call(folder, b"GET /v1/sta").close()
    until(lambda: control.poll() or control.dropped)
    assert control.dropped == {"cut short": 1}
    caller = call(folder, http_request("GET", "/v1/status"))
    request = next_request(control)
    caller.close()
    control.answer(request, OrderReply(True, "done"))
    control.answer(request, OrderReply(True, "twice"))
    assert control.dropped == {"cut short": 1, "nobody waits": 2}


def test_who_stays_silent_makes_room_in_time_and_keeps_nobody_waiting(control: Control, folder: StateFolder) -> None:
    with ExitStack() as callers:
        silent = [callers.enter_context(call(folder)) for _ in range(MOST_CALLERS)]
        assert control.poll(0) == []
        caller = callers.enter_context(call(folder, http_request("POST", "/v1/reload", b"{}")))  # in the socket's queue
        assert control.poll(CALLER_LIMIT_NS) == []
        assert control.dropped == {}
        assert control.poll(CALLER_LIMIT_NS + 1) == []
        assert control.dropped == {"silent": MOST_CALLERS}
        (request,) = control.poll(CALLER_LIMIT_NS + 2)
        assert request.order == ReloadOrder()
        assert control.poll(2 * CALLER_LIMIT_NS + 2) == []
        assert control.dropped == {"silent": MOST_CALLERS}
        assert control.poll(2 * CALLER_LIMIT_NS + 3) == []
        assert control.dropped == {"silent": MOST_CALLERS, "slow": 1}
        for each in (*silent, caller):
            assert each.recv(10) == b""


def test_many_may_ask_at_once(control: Control, folder: StateFolder, people: ThreadPoolExecutor) -> None:
    answers = [people.submit(ask, folder, KickOrder(str(number)), LIMIT_S) for number in range(MOST_CALLERS + 4)]

    def serve() -> bool:
        for request in control.poll():
            assert isinstance(request.order, KickOrder)
            control.answer(request, OrderReply(True, f"kicked {request.order.user}"))
        return all(answer.done() for answer in answers)

    until(serve)
    assert [answer.result().text for answer in answers] == [f"kicked {number}" for number in range(len(answers))]


# --- where there is no answer -----------------------------------------------------------------------------------------


def test_a_missing_server_is_named(folder: StateFolder) -> None:
    words = (
        f"no server is running with the state in {folder.path}; start it, or name the right one by --state or --port"
    )
    with pytest.raises(NotRunningError, match=words):
        ask(folder, ReloadOrder())
    Control(folder).close()
    with pytest.raises(NotRunningError, match=words):
        ask(folder, ReloadOrder())


def test_what_a_killed_server_left_is_in_nobodys_way(folder: StateFolder, people: ThreadPoolExecutor) -> None:
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as left:
        left.bind(os.fspath(folder.control))
    with pytest.raises(NotRunningError):
        ask(folder, ReloadOrder())
    control = Control(folder)
    answer = people.submit(ask, folder, ReloadOrder(), LIMIT_S)
    control.answer(next_request(control), OrderReply(True, "done"))
    assert answer.result(LIMIT_S).ok
    control.close()


def test_a_server_that_hangs_is_named(control: Control, folder: StateFolder) -> None:
    words = r"did not answer within 0.01 s; if it is stopped or hangs, start it again"
    with pytest.raises(ControlError, match=words):
        ask(folder, ReloadOrder(), 0.01)
    with ExitStack() as waiting:
        with suppress(BlockingIOError):
            while True:
                each = waiting.enter_context(socket.socket(socket.AF_UNIX, socket.SOCK_STREAM))
                each.setblocking(False)
                each.connect(os.fspath(folder.control))
        with pytest.raises(ControlError, match=words):
            ask(folder, ReloadOrder(), 0.01)


def test_a_server_that_ends_before_it_answers_is_named(folder: StateFolder, people: ThreadPoolExecutor) -> None:
    control = Control(folder)
    answer = people.submit(ask, folder, ReloadOrder(), LIMIT_S)
    next_request(control)
    control.close()
    with pytest.raises(ControlError, match="broke off before it answered"):
        answer.result(LIMIT_S)


def test_a_path_that_no_socket_takes_is_named(tmp_path) -> None:
    rest = MOST_PATH_BYTES - len(os.fsencode(tmp_path)) - len("//control")
    Control(make_folder(tmp_path / ("a" * rest))).close()
    folder = make_folder(tmp_path / ("a" * (rest + 1)))
    words = rf"{MOST_PATH_BYTES + 1} bytes are more than .* \({MOST_PATH_BYTES}\); give a shorter --state"
    for use in (lambda: Control(folder), lambda: ask(folder, ReloadOrder())):
        with pytest.raises(ControlError, match=words):
            use()


def test_a_path_that_cannot_be_bound_is_named(folder: StateFolder) -> None:
    folder.control.mkdir()
    with pytest.raises(ControlError, match="cannot be listened on"):
        Control(folder)
    folder.control.rmdir()
    write_private(folder.control, b"")
    with pytest.raises(NotRunningError):
        ask(folder, ReloadOrder())


# --- events -----------------------------------------------------------------------------------------------------------


def stream(control: Control, folder: StateFolder, target: str = "/v1/events") -> socket.socket:
    """Return a connection on which events come, from the next one on."""
    before = len(control._streams)
    caller = call(folder, http_request("GET", target))
    until(lambda: control.poll() or len(control._streams) > before)
    return caller


def told(control: Control, caller: socket.socket, count: int) -> list[dict[str, Any]]:
    """Return the next events, read by Python's own HTTP."""
    response = http.client.HTTPResponse(caller)
    response.begin()
    assert response.getheader("content-type") == "text/event-stream"
    lines: list[str] = []
    while sum(line.startswith("data: ") for line in lines) < count:
        control.poll()
        lines.append(response.readline().decode().rstrip("\n"))
    return [json.loads(line.removeprefix("data: ")) for line in lines if line.startswith("data: ")]


def test_events_come_as_they_are_to_whoever_asks_for_them(control: Control, folder: StateFolder) -> None:
    joined, marker = (
        ServerEvent("joined", "lab: anna joined", "lab", "anna"),
        ServerEvent("marker", "hall: trial 1", "hall"),
    )
    control.publish(joined)  # to nobody
    with ExitStack() as callers:
        every, lab, markers = (
            callers.enter_context(stream(control, folder, f"/v1/events{query}"))
            for query in ("", "?room=lab", "?event=marker")
        )
        for event in (joined, marker, joined):
            control.publish(event)
        assert told(control, every, 3) == [msgspec.to_builtins(each) for each in (joined, marker, joined)]
        assert told(control, lab, 2) == [msgspec.to_builtins(joined)] * 2
        assert told(control, markers, 1) == [msgspec.to_builtins(marker)]


def test_a_stream_goes_on_where_one_before_ended(control: Control, folder: StateFolder) -> None:
    events = [ServerEvent("notice", f"{number}") for number in range(MOST_KEPT + 10)]
    for event in events:
        control.publish(event)
    with stream(control, folder, f"/v1/events?after={MOST_KEPT + 7}") as last:
        assert [each["text"] for each in told(control, last, 3)] == [f"{MOST_KEPT + more}" for more in (7, 8, 9)]
    with stream(control, folder, "/v1/events?after=0") as first:
        assert [each["text"] for each in told(control, first, MOST_KEPT)] == [event.text for event in events[10:]]


def test_a_reader_that_does_not_read_loses_events_and_is_told_how_many(control: Control, folder: StateFolder) -> None:
    event = ServerEvent("notice", "x" * 1000)
    with stream(control, folder) as caller:
        while control.dropped["event without a reader"] < 5:
            control.publish(event)
            control.poll()
        assert len(control._streams[0].unsent) < MOST_UNSENT_BYTES + 2000
        found: list[dict[str, Any]] = []
        with call(folder) as other:  # nobody waits for a slow reader
            other.sendall(http_request("POST", "/v1/reload", b"{}"))
            assert next_request(control).order == ReloadOrder()
        response = http.client.HTTPResponse(caller)
        response.begin()
        while not found or found[-1]["event"] != LOST:
            control.poll()
            line = response.readline()
            if line.startswith(b"data: "):
                found.append(json.loads(line[6:]))
            if not control._streams[0].unsent and control._streams[0].lost:
                control.publish(event)
        assert found[-1]["text"] == "5 events were not told: read faster"


def test_a_reader_that_goes_makes_room_and_too_many_are_refused(control: Control, folder: StateFolder) -> None:
    with ExitStack() as readers:
        for number in range(MOST_STREAMS):
            readers.enter_context(call(folder, http_request("GET", "/v1/events")))
            until(lambda number=number: control.poll() or len(control._streams) > number)
        with call(folder, http_request("GET", "/v1/events")) as one_more:
            until(lambda: control.poll() or not control._callers)
            assert one_more.recv(100).startswith(b"HTTP/1.1 503 ")
    until(lambda: control.publish(ServerEvent("notice", "x")) or control.poll() or not control._streams)


def test_a_stream_without_events_shows_that_it_lives(control: Control, folder: StateFolder) -> None:
    with stream(control, folder) as caller:
        assert b": alive" in caller.recv(1000)
        control.poll(time.monotonic_ns() + ALIVE_NS)
        assert b": alive" in caller.recv(1000)


# --- what it says of itself ---------------------------------------------------------------------------------------------


def test_the_document_of_the_interface_is_openapi_and_says_each_operation() -> None:
    document = json.loads(msgspec.json.encode(openapi()))
    openapi_spec_validator.validate(document)
    plain = ("events", "metrics", "settable", "openapi.json")
    assert set(document["paths"]) == {each.path for each in OPERATIONS} | {f"/v1/{name}" for name in plain}
    schema = document["components"]["schemas"]["KickOrder"]
    assert (set(schema["properties"]), schema["required"]) == ({"user", "room", "reason", "revoke"}, ["user"])


def test_where_metrics_are_is_told(control: Control, folder: StateFolder, people: ThreadPoolExecutor) -> None:
    control.metrics_at = "http://127.0.0.1:9147/metrics"
    with call(folder, http_request("GET", "/v1/metrics")) as caller:
        until(lambda: control.poll() or not control._callers)
        response = http.client.HTTPResponse(caller)
        response.begin()
        assert (response.status, response.getheader("location")) == (307, control.metrics_at)


@pytest.mark.parametrize(
    ("body", "order"),
    [
        ({"user": "anna", "values": {"stiffness_npm": 500, "clutch": True, "rotation": [0, 0, 0.5]}},
         SetHandOrder("anna", parsed(["stiffness_npm=500", "clutch=on", "rotation=0,0,0.5"]))),
        ({"user": "anna", "values": {"impedance_nspm": "auto"}, "room": "lab"},
         SetHandOrder("anna", parsed(["impedance_nspm=auto"]), "lab")),
        ({"values": {"object.mass_kg": 0.5}}, SetRoomOrder(RoomChange(0.5))),
        (
            {"values": {"scene.gravity_mps2": 3, "effects.push": "anna, ben"}, "room": "lab"},
            SetRoomOrder(RoomChange(scene_gravity_mps2=3.0, effects={"push": "anna,ben"}), "lab"),
        ),
    ],
)  # fmt: skip
def test_values_of_json_are_those_of_the_command(body: dict[str, Any], order: SetHandOrder | SetRoomOrder) -> None:
    assert order_of("POST", "/v1/set", json.dumps(body).encode()) == order


@pytest.mark.parametrize(
    "asked",
    [
        EventFilter(), EventFilter("lab", "joined", 0), EventFilter(after=7), WhoOrder("group 7"), StatusOrder(),
        KickOrder("anna", "lab", "too rough", True), NewRoomOrder("lesson", "", {"class": "physics"}),
        CloseRoomOrder("group 7"),
    ],
)  # fmt: skip
def test_a_request_is_read_as_what_was_asked(asked: Any) -> None:
    assert order_of(*request_of(asked)) == asked
