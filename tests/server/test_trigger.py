"""Trigger line on a pseudo-terminal: what comes out of it, and what is refused; and a live server that records its writes."""

import os
import select
from collections.abc import Iterator
from unittest.mock import Mock

import pytest
import serial

from cogrip.cli.main import main
from cogrip.devices.io.platform import open_pseudo_terminal
from cogrip.server.io.trigger import CODES, MOST_WAITING, Trigger, TriggerError, TriggerLine, measure

from tests.cli.command import Cogrip

LIMIT_S = 60.0


class Wire:
    """A pseudo-terminal: `path` of the port, and what was sent on it."""

    def __init__(self) -> None:
        self._ours, self._theirs, self.path = open_pseudo_terminal()

    def read(self, count: int) -> list[int]:
        """Wait for so many bytes."""
        found = b""
        while len(found) < count:
            assert select.select([self._ours], [], [], LIMIT_S)[0], f"only {len(found)} of {count} bytes came"
            found += os.read(self._ours, count - len(found))
        return list(found)

    def unplug(self) -> None:
        for end in (self._ours, self._theirs):
            os.close(end)
        self._ours = -1

    def close(self) -> None:
        if self._ours >= 0:
            self.unplug()


@pytest.fixture
def wire() -> Iterator[Wire]:
    yield (made := Wire())
    made.close()


def test_every_marker_is_a_byte_of_its_own_and_then_zero(wire: Wire) -> None:
    trigger = Trigger(TriggerLine(f"byte:{wire.path}"))
    assert wire.read(1) == [0], "at rest from the beginning"
    for number in range(3):
        trigger.fire(f"marker {number}")
    assert wire.read(6) == [1, 0, 2, 0, 3, 0]
    trigger.close()
    written = trigger.take()
    assert [(each.text, each.code) for each in written] == [(f"marker {number}", number + 1) for number in range(3)]
    assert all(each.after_ns > 0 for each in written)
    assert written[0].at_ns < written[1].at_ns < written[2].at_ns
    assert (trigger.take(), trigger.counts, trigger.trouble) == ([], {}, "")


def test_markers_have_the_codes_that_they_were_given(wire: Wire) -> None:
    trigger = Trigger(TriggerLine(f"byte:{wire.path}"), {"begin it": 7, "lamp on": 200})
    assert wire.read(1) == [0]
    for text in ("demo: marker: begin it", "demo: marker: something else", "demo: anna marker: lamp on"):
        trigger.fire(text)
    assert wire.read(4) == [7, 0, 200, 0]
    trigger.close()
    assert [each.code for each in trigger.take()] == [7, 200]


def test_a_marker_without_a_code_has_that_of_all_others(wire: Wire) -> None:
    trigger = Trigger(TriggerLine(f"byte:{wire.path}"), {"lamp on": 3, "*": 9})
    for text in ("demo: marker: lamp on", "demo: marker: lamp off"):
        trigger.fire(text)
    assert wire.read(5) == [0, 3, 0, 9, 0]
    trigger.close()


def test_codes_begin_anew_after_the_last(wire: Wire, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("cogrip.server.io.trigger.PULSE_S", 0.0)
    trigger = Trigger(TriggerLine(f"byte:{wire.path}"))
    sent: list[int] = []
    for number in range(CODES + 1):
        trigger.fire(str(number))
        sent += wire.read(2)
    trigger.close()
    assert [code for code in sent if code] == [*range(1, CODES + 1), 1]


class Levels(serial.Serial):
    """A port whose lines RTS and DTR can be looked at: a pseudo-terminal has none."""

    def __init__(self, *arguments: object, **settings: object) -> None:
        self.levels: list[tuple[str, bool]] = []
        super().__init__(*arguments, **settings)

    def _update_rts_state(self) -> None:
        self.levels.append(("rts", self._rts_state))

    def _update_dtr_state(self) -> None:
        self.levels.append(("dtr", self._dtr_state))


@pytest.mark.parametrize("signal", ["rts", "dtr"])
def test_line_rises_and_falls(wire: Wire, monkeypatch: pytest.MonkeyPatch, signal: str) -> None:
    monkeypatch.setattr(serial, "Serial", Levels)
    line = TriggerLine(f"{signal}:{wire.path}")
    trigger = Trigger(line)
    trigger.fire("begin")
    trigger.close()
    assert isinstance(line.line, Levels)
    mine = [level for name, level in line.line.levels if name == signal]
    assert mine[-3:] == [True, False, False]
    assert not any(mine[:-3])


@pytest.mark.parametrize("draining", [False, True])
def test_port_that_is_lost_is_said_once_and_counted_and_the_thread_goes_on(wire: Wire, draining: bool) -> None:
    """While it drains, pyserial lets the terminal's own error through, which is no OSError."""
    line = TriggerLine(f"byte:{wire.path}")
    if draining:
        line.line.flush = Mock(side_effect=RuntimeError("as termios.error"))  # type: ignore[method-assign]
    else:
        wire.unplug()
    trigger = Trigger(line)
    trigger.fire("one")
    trigger.fire("two")
    trigger.close()
    assert trigger.counts == {"trigger not written": 2}
    assert "markers reach it no more" in trigger.trouble
    assert trigger.take() == []


def test_a_port_that_hangs_makes_nobody_wait(wire: Wire, monkeypatch: pytest.MonkeyPatch) -> None:
    trigger = Trigger(TriggerLine(f"byte:{wire.path}"))
    trigger.close()  # nobody writes any more
    for number in range(MOST_WAITING + 5):
        trigger.fire(str(number))
    assert trigger.counts == {"trigger: too many markers": 5}


@pytest.mark.parametrize(
    ("address", "words"),
    [
        ("usb", "'usb' is no trigger; give rts:PORT, dtr:PORT or byte:PORT"),
        ("rts:", "is no trigger"),
        ("cts:/dev/ttyUSB0", "is no trigger"),
        ("byte:nowhere/tty", "byte:nowhere/tty: No such file or directory; plug it in, or name another port"),
    ],
)
def test_address_that_is_no_port_is_refused(address: str, words: str) -> None:
    with pytest.raises(TriggerError) as refused:
        TriggerLine(address)
    assert words in str(refused.value)
    assert "\n" not in str(refused.value)


def test_terminal_without_lines_and_port_in_use_are_refused(wire: Wire) -> None:
    with pytest.raises(TriggerError, match="has no line RTS; take byte:PORT"):
        TriggerLine(f"rts:{wire.path}")
    line = TriggerLine(f"byte:{wire.path}")
    with pytest.raises(TriggerError, match="close the program that uses it"):
        TriggerLine(f"byte:{wire.path}")
    line.close()


def test_measured_without_anything_coming_back(wire: Wire, monkeypatch: pytest.MonkeyPatch) -> None:
    line = TriggerLine(f"byte:{wire.path}")
    monkeypatch.setattr("cogrip.server.io.trigger.WRITE_LIMIT_S", 0.01)  # for what comes back: the port's own stays
    writes, loops = measure(line, 3)
    line.close()
    assert (len(writes), loops) == (3, [])


def test_commands_measure_a_line_and_do_not_begin_without_it(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("cogrip.cli.session.trigger_line.MEASURED", 3)
    cogrip = Cogrip(main, capsys)
    out, _ = cogrip.texts("doctor", "--trigger", "byte:pty")
    write, loop = out.splitlines()[1:]
    assert write.startswith("  write: p50 ")
    assert loop.startswith("  there and back: p50 ")
    words = cogrip.err("serve", "demo", "--trigger", "rts:nowhere")
    assert "--trigger rts:nowhere: No such file or directory" in words


@pytest.mark.parametrize(
    ("flags", "words"),
    [
        (["--trigger-code", "lamp=3"], "add --trigger byte:PORT"),
        (["--trigger", "rts:/dev/nothing", "--trigger-code", "lamp=3"], "a line that sends bytes"),
        *(
            (["--trigger", "byte:/dev/nothing", "--trigger-code", each], "give TEXT=CODE")
            for each in ("lamp", "lamp=0", "=3", "a=256", "a=x")
        ),
    ],
)
def test_codes_that_cannot_be_are_refused(flags: list[str], words: str, capsys: pytest.CaptureFixture[str]) -> None:
    code, _, said = Cogrip(main, capsys)("serve", "demo", *flags)
    assert code == 2
    assert words in " ".join(said.split())
