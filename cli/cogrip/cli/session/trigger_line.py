"""Trigger line of a session, as a command names it: opened, tried, measured."""

import os
import select
import threading
from collections.abc import Mapping, Sequence
from contextlib import ExitStack, suppress
from statistics import quantiles

from cogrip.cli.terminal.problem import BadInput, Problem
from cogrip.devices.io.platform import PSEUDO_TERMINALS, open_pseudo_terminal
from cogrip.server.io.trigger import CODES, Trigger, TriggerError, TriggerLine, measure

MEASURED = 100  # number of pulses that are measured
PTY = "byte:pty"
NOTHING_BACK = (
    "nothing came back: bridge TX and RX (byte), RTS and CTS (rts), DTR and DSR (dtr) to measure the whole way"
)


def trigger_codes(address: str | None, given: Sequence[str]) -> dict[str, int]:
    """Return the codes of markers by their words, as flags give them, TEXT=CODE. Raises BadInput."""
    found: dict[str, int] = {}
    if given and not (address or "").startswith("byte:"):
        raise BadInput("--trigger-code is for a line that sends bytes: add --trigger byte:PORT")
    for each in given:
        text, _, code = each.rpartition("=")
        if not text or not code.isdecimal() or not 1 <= int(code) <= CODES:
            raise BadInput(f"--trigger-code {each!r}: give TEXT=CODE, a marker's words and a number from 1 to {CODES}")
        found[text] = int(code)
    return found


def open_trigger(address: str | None, stack: ExitStack, codes: Mapping[str, int] | None = None) -> Trigger | None:
    """Return the trigger, closed with `stack`; None where none is asked for. Raises BadInput."""
    if address is None:
        return None
    with BadInput.of(TriggerError, where="--trigger "):
        trigger = Trigger(TriggerLine(address), codes)
    stack.callback(trigger.close)
    return trigger


def try_trigger(address: str) -> None:
    """Open a line and close it again. Raises BadInput where it cannot be had."""
    with BadInput.of(TriggerError, where="--trigger "):
        TriggerLine(address).close()


def measured_trigger(address: str) -> list[str]:
    """Return lines about the latency of a trigger line. address: byte:pty stands for a pseudo-terminal of our own.

    Raises BadInput where it cannot be had, Problem where it is lost meanwhile.
    """
    with ExitStack() as stack:
        if address == PTY:
            address = f"byte:{_echoing(stack)}"
        with BadInput.of(TriggerError, where="--trigger "):
            line = TriggerLine(address)
        stack.callback(line.close)
        with Problem.of(OSError, where=f"{address}: "):
            writes, loops = measure(line, MEASURED)
    lines = [f"trigger {address}, {MEASURED} pulses", f"  write: {_shown(writes)}"]
    return [*lines, f"  there and back: {_shown(loops)}" if len(loops) > 1 else f"  {NOTHING_BACK}"]


def _echoing(stack: ExitStack) -> str:
    """Return the path of a pseudo-terminal that sends back what it gets, until `stack` is closed. Raises BadInput."""
    if not PSEUDO_TERMINALS:
        raise BadInput(f"--trigger {PTY}: there are no pseudo-terminals here; name a serial port")
    ours, theirs, path = open_pseudo_terminal()
    over = threading.Event()

    def echo() -> None:
        while not over.is_set():
            if select.select([ours], [], [], 0.1)[0]:
                with suppress(OSError):  # nobody has it open now
                    os.write(ours, os.read(ours, 256))

    thread = threading.Thread(target=echo, daemon=True)
    thread.start()

    def close() -> None:
        over.set()
        thread.join()
        os.close(ours)
        os.close(theirs)

    stack.callback(close)
    return path


def _shown(times_s: list[float]) -> str:
    cuts = quantiles(times_s, n=100, method="inclusive")
    return f"p50 {1e3 * cuts[49]:.3f}  p99 {1e3 * cuts[98]:.3f}  max {1e3 * max(times_s):.3f} ms"
