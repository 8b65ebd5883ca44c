"""A running server and the commands that ask it: real sockets, a server that never waits, and words for all that fails."""

import json
import os
import socket
import stat
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, suppress

import pytest

from cogrip.server.io.control import (
    CALLER_LIMIT_NS,
    MOST_ANSWER_BYTES,
    MOST_CALLERS,
    MOST_PATH_BYTES,
    MOST_REQUEST_BYTES,
    Control,
    ControlError,
    KickOrder,
    NotRunningError,
    OrderReply,
    ReloadOrder,
    Request,
    StatusOrder,
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
        control.answer(request, "said – done", ok=ok)
        assert answer.result(LIMIT_S) == OrderReply(ok, "said – done")
    assert control.dropped == {}


def test_only_this_user_may_ask_and_nobody_asking_costs_nothing(control: Control, folder: StateFolder) -> None:
    assert folder.control.stat().st_mode == stat.S_IFSOCK | 0o600
    assert control.poll() == []
    assert control.dropped == {}


def test_the_largest_answer_comes_whole(control: Control, folder: StateFolder, people: ThreadPoolExecutor) -> None:
    fits = MOST_ANSWER_BYTES - len(b'{"ok":true,"text":""}\n')
    for size, ok in ((fits, True), (fits + 1, False)):
        answer = people.submit(ask, folder, StatusOrder(), LIMIT_S)
        control.answer(next_request(control), "x" * size)
        until(lambda answer=answer: control.poll() or answer.done())
        assert answer.result().ok is ok
    assert answer.result().text == f"the answer would have {MOST_ANSWER_BYTES + 1} bytes, too many"


@pytest.mark.parametrize(
    ("said", "reason"),
    [
        (b"\n", "malformed"),
        (b"hello\n", "malformed"),
        (b"\xff\xfe\n", "malformed"),
        (b"[" * 4000 + b"\n", "malformed"),
        (b'{"verb":"fly"}\n', "malformed"),
        (b'{"verb":"kick"}\n', "malformed"),
        (b'{"verb":"kick","user":7}\n', "malformed"),
        (b'{"verb":"kick","user":"a","usr":"b"}\n', "malformed"),
        (json.dumps({"verb": "kick", "user": "a" * 41}).encode() + b"\n", "malformed"),
        (json.dumps({"verb": "kick", "user": "a", "reason": "r" * 201}).encode() + b"\n", "malformed"),
        (b'{"verb":"reload"}\n{"verb":"reload"}\n', "malformed"),
        (b"x" * MOST_REQUEST_BYTES + b"\n", "too long"),
        (b"x" * (MOST_REQUEST_BYTES + 1), "too long"),
    ],
)
def test_no_order_is_counted_and_answered(control: Control, folder: StateFolder, said: bytes, reason: str) -> None:
    with call(folder, said) as caller:
        until(lambda: control.poll() or control.dropped)
        assert control.dropped == {reason: 1}
        answer = json.loads(caller.recv(MOST_REQUEST_BYTES))
    assert not answer["ok"]
    assert answer["text"]
    assert control.poll() == []


def test_the_longest_order_is_read_also_in_pieces(control: Control, folder: StateFolder) -> None:
    order = b'{"verb":"reload"}'.ljust(MOST_REQUEST_BYTES - 1) + b"\n"
    with call(folder, order):
        assert next_request(control).order == ReloadOrder()
    with call(folder, order[:10]) as caller:
        assert control.poll() == []
        assert control.poll() == []
        caller.sendall(order[10:])
        assert next_request(control).order == ReloadOrder()


def test_who_breaks_off_and_who_asks_and_goes_is_counted(control: Control, folder: StateFolder) -> None:
    call(folder, b'{"verb":').close()
    until(lambda: control.poll() or control.dropped)
    assert control.dropped == {"cut short": 1}
    caller = call(folder, b'{"verb":"status"}\n')
    request = next_request(control)
    caller.close()
    control.answer(request, "done")
    control.answer(request, "twice")
    assert control.dropped == {"cut short": 1, "nobody waits": 2}


def test_who_stays_silent_makes_room_in_time_and_keeps_nobody_waiting(control: Control, folder: StateFolder) -> None:
    with ExitStack() as callers:
        silent = [callers.enter_context(call(folder)) for _ in range(MOST_CALLERS)]
        assert control.poll(0) == []
        caller = callers.enter_context(call(folder, b'{"verb":"reload"}\n'))  # in the socket's queue
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
            control.answer(request, f"kicked {request.order.user}")
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
    control.answer(next_request(control), "done")
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
