"""Log of a page's process: peers can make it a bounded number of lines, whichever logger they go through."""

import logging
from itertools import chain, repeat

import pytest

from cogrip.server.rate_limit import Budget
from cogrip.view.io.peer_log import PEER_LOG, PeerLog, bound_log

SECOND_NS = 1_000_000_000
LOGGERS = ("asyncio", "websockets.server", "websockets", "ssl", "cogrip.view", "a library of tomorrow", "")


def defect() -> logging.LogRecord:
    try:
        raise ZeroDivisionError("two\x1b[2Jlines")
    except ZeroDivisionError as error:
        return logging.LogRecord("asyncio", logging.ERROR, "", 1, "a\nb", (), (type(error), error, error.__traceback__))


def test_all_loggers_share_one_budget_by_lines(capsys: pytest.CaptureFixture[str], monkeypatch) -> None:
    now_ns = [SECOND_NS]
    handler = PeerLog(Budget(1, 20), lambda: now_ns[0])
    root = logging.getLogger()
    monkeypatch.setattr(root, "handlers", [handler])
    for name in chain.from_iterable(repeat(LOGGERS, 100)):
        logging.getLogger(name).warning("socket.send() raised exception.")
        logging.getLogger(name).info("connection open")
    assert len(capsys.readouterr().err.splitlines()) == 20
    assert handler.take_dropped() == 100 * len(LOGGERS) - 20
    now_ns[0] += 3 * SECOND_NS
    for _ in range(10):
        root.handle(defect())
    assert len(capsys.readouterr().err.splitlines()) == 3
    assert handler.take_dropped() > 10
    assert handler.take_dropped() == 0


def test_a_peers_bytes_move_no_cursor(capsys: pytest.CaptureFixture[str]) -> None:
    PeerLog().handle(defect())
    lines = capsys.readouterr().err.splitlines()
    assert lines[:2] == ["a", "b"]
    assert "two\\x1b[2Jlines" in lines[-1]


def test_it_is_installed_once() -> None:
    handlers = logging.getLogger().handlers
    assert bound_log() is bound_log() is PEER_LOG
    assert handlers.count(PEER_LOG) == 1
