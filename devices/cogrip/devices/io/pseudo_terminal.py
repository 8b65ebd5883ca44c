"""An emulated device on a pseudo-terminal, in real time: programs open it as they would the real one.

Its verbs come as lines: a fault's name and how many seconds it lasts (`silence 0.3`), `mend`, `press` (the calibrate button),
`status`, `quit`. Unplugging makes the terminal disappear; `mend` makes a new one, and the link shows to it.
"""

from __future__ import annotations

import os
import select
import time
import tty
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from cogrip.devices.emulated.faults import VERBS
from cogrip.devices.emulated.firmware import Firmware

IDLE_S = 0.02  # how long the arm's mechanics may stand still


class PseudoTerminal:
    """A firmware behind a pty. `run` returns on `quit`, at the end of the verbs' input, or when `stopped` says so."""

    def __init__(self, firmware: Firmware, link: Path | None, say: Callable[[str], None]) -> None:
        self._firmware = firmware
        self._link = link
        self._say = say
        self._master = self._slave = -1
        self._verbs = self._late = b""
        self.path = ""

    def plug(self) -> None:
        """A new terminal. Raises OSError."""
        self._master, self._slave = os.openpty()
        tty.setraw(self._master)
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        self.path = os.ttyname(self._slave)
        if self._link is not None:
            new = self._link.with_name(f".{self._link.name}.new")
            new.unlink(missing_ok=True)
            new.symlink_to(self.path)
            new.replace(self._link)

    def unplug(self) -> None:
        """The link goes too: another program may get a terminal of the same name."""
        self._late = b""
        if self._link is not None:
            self._link.unlink(missing_ok=True)
        for descriptor in (self._master, self._slave):
            with suppress(OSError):
                os.close(descriptor)
        self._master = self._slave = -1

    def run(self, verbs: int | None, stopped: Callable[[], bool]) -> None:
        """verbs: a descriptor that lines are read from; None for none."""
        begun_ns = time.monotonic_ns()
        firmware = self._firmware
        try:
            while not stopped():
                sources = [source for source in (self._master, verbs) if source is not None and source >= 0]
                wait_s = 0.0005 if firmware.faults.waiting else IDLE_S
                ready = select.select(sources, [], [], wait_s)[0]
                now_ns = time.monotonic_ns() - begun_ns
                firmware.advance(now_ns)
                if self._master in ready:
                    with suppress(OSError):  # nobody has it open
                        firmware.receive(os.read(self._master, 4096), now_ns)
                self._late += b"".join(firmware.due(now_ns))
                if self._late and self._master >= 0:
                    with suppress(BlockingIOError):  # nobody reads
                        self._late = self._late[os.write(self._master, self._late) :]
                    self._late = self._late[-4096:]
                if verbs is not None and verbs in ready and not self._listen(verbs):
                    return
                if firmware.plugged != (self._master >= 0):
                    self._follow()
        finally:
            self.unplug()

    def _follow(self) -> None:
        if self._firmware.plugged:
            self.plug()
            self._say(f"plugged in again: {self._link or self.path}")
        else:
            self.unplug()
            self._say("unplugged")

    def _listen(self, verbs: int) -> bool:
        """Do what the lines say; False to end."""
        data = os.read(verbs, 4096)
        if not data:
            return False
        *lines, self._verbs = (self._verbs + data).split(b"\n")
        return all(self._do(line.decode(errors="replace").split()) for line in lines)

    def _do(self, words: list[str]) -> bool:
        firmware = self._firmware
        match words:
            case []:
                pass
            case ["quit"]:
                return False
            case ["mend"]:
                firmware.mend()
                self._say("mended")
            case ["press"]:
                firmware.press()
                self._say("the calibrate button was pressed: the counters are zero")
            case ["status"]:
                mechanics = firmware.mechanics
                at = ", ".join(f"{1e3 * place:.3f}" for place in mechanics.body.position_m)
                force = ", ".join(f"{part:.3f}" for part in mechanics.force_n)
                self._say(
                    f"at ({at}) mm, counters {mechanics.counters}, "
                    f"pushes with ({force}) N, most so far {mechanics.peak_force_n:.3f} N"
                )
            case [verb] | [verb, _] if verb in VERBS and all(_is_number(word) for word in words[1:]):
                firmware.fault(verb, *map(float, words[1:]))
                self._say(f"fault {' '.join(words)}")
            case _:
                self._say(
                    f"{' '.join(words)!r}: write a fault and its seconds ({', '.join(VERBS)}), mend, press, status or quit"
                )
        return True


def _is_number(word: str) -> bool:
    try:
        return float(word) > 0.0
    except ValueError:
        return False
