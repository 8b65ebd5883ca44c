"""An emulated device in real time, on whatever wire: programs open it as they would the real one.

Its verbs come as lines: a fault's name and how many seconds it lasts (`silence 0.3`), `mend`, `press` (the calibrate button),
`status`, `quit`. Unplugging makes the wire disappear; `mend` makes a new one.
"""

import os
import select
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence

from cogrip.devices.emulated.faults import VERBS
from cogrip.devices.emulated.firmware import Firmware

IDLE_S = 0.02  # longest time for which the arm's mechanics may stand still


class ServedFirmware(ABC):
    """A firmware behind a wire. `run` returns on `quit`, at the end of the verbs' input, or when `stopped` says so.

    path: where programs find it, while it is plugged in.
    """

    def __init__(self, firmware: Firmware, say: Callable[[str], None]) -> None:
        self._firmware = firmware
        self._say = say
        self._verbs = b""
        self.path = ""

    @property
    def where(self) -> str:
        """Name that people are told to open."""
        return self.path

    @property
    @abstractmethod
    def plugged(self) -> bool:
        """Return whether the wire is there."""

    @abstractmethod
    def plug(self) -> None:
        """A new wire. Raises OSError."""

    @abstractmethod
    def unplug(self) -> None:
        """It is gone, and what was on its way."""

    @abstractmethod
    def sources(self) -> Sequence[int]:
        """Descriptors on which something may come."""

    @abstractmethod
    def received(self, ready: Sequence[int]) -> Sequence[bytes]:
        """Return what has come on those that are ready: bytes, or one report each."""

    @abstractmethod
    def tell(self, replies: Sequence[bytes]) -> None:
        """Send these, and what could not be sent before."""

    def run(self, verbs: int | None, stopped: Callable[[], bool]) -> None:
        """verbs: a descriptor that lines are read from; None for none."""
        begun_ns = time.monotonic_ns()
        firmware = self._firmware
        try:
            while not stopped():
                sources = [*self.sources(), *([verbs] if verbs is not None else [])]
                wait_s = 0.0005 if firmware.faults.waiting else IDLE_S
                ready = select.select(sources, [], [], wait_s)[0]
                now_ns = time.monotonic_ns() - begun_ns
                firmware.advance(now_ns)
                for data in self.received(ready):
                    firmware.receive(data, now_ns)
                self.tell(firmware.due(now_ns))
                if verbs is not None and verbs in ready and not self._listen(verbs):
                    return
                if firmware.plugged != self.plugged:
                    self._follow()
        finally:
            self.unplug()

    def _follow(self) -> None:
        if self._firmware.plugged:
            self.plug()
            self._say(f"plugged in again: {self.where}")
        else:
            self.unplug()
            self._say("unplugged")

    def _listen(self, verbs: int) -> bool:
        """Execute the lines; return False to end."""
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
                zero = not any(firmware.mechanics.counters)
                self._say(f"the calibrate button was pressed: the {'counters are zero' if zero else 'host is told'}")
            case ["status"]:
                mechanics = firmware.mechanics
                at = ", ".join(f"{1e3 * place:z.3f}" for place in mechanics.body.position_m)
                force = ", ".join(f"{part:z.3f}" for part in mechanics.force_n)
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
