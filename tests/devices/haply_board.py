"""An emulated Haply board at a pseudo-terminal, whose time is a millisecond for every read."""

import os
import pty
import select
import threading
import tty
from collections.abc import Callable
from itertools import count

from cogrip.devices.emulated.haply_firmware import HaplyFirmware
from cogrip.devices.family.machines import make_firmware
from cogrip.devices.settings import parse_address

from tests.fair_time import FairTime

BOUND_S = 60.0  # for anything that is waited for, in time as the machine gives it
LOOK_S = 1.0


class Board:
    """Served by a thread that only wakes for bytes. history: torques after each request; acted: place and force, each reply."""

    def __init__(self, name: str = "2diy", hand: str = "hold") -> None:
        firmware = make_firmware(name, parse_address(f"sim:phantom?hand={hand}").query)
        assert isinstance(firmware, HaplyFirmware)
        self.firmware = firmware
        self.history: list[tuple[float, float]] = []
        self.acted: list[tuple[float, ...]] = []
        self._changed = threading.Condition()
        self._master, self._slave = pty.openpty()
        tty.setraw(self._slave)
        self.path = os.ttyname(self._slave)
        self._wake, self._stop = os.pipe()
        self._thread = threading.Thread(target=self._serve)
        self._thread.start()

    def _serve(self) -> None:
        for now_ns in count(step=1_000_000):
            if self._wake in select.select([self._master, self._wake], [], [])[0]:
                return
            data = os.read(self._master, 4096)
            with self._changed:
                self.firmware.receive(data, now_ns)
                replies = self.firmware.due(now_ns)
                mechanics = self.firmware.mechanics
                self.acted += len(replies) * [(*mechanics.body.position_m[:2], *mechanics.force_n[:2])]
                for reply in replies:
                    os.write(self._master, reply)
                # several requests may come in one read
                self.history += max(1, len(replies)) * [self.firmware.torque_nm]
                self._changed.notify_all()

    def wait(self, until: Callable[[], bool]) -> None:
        given = FairTime()
        with self._changed:
            while not self._changed.wait_for(until, LOOK_S):
                assert given.spent_s() < BOUND_S

    def close(self) -> None:
        os.close(self._stop)
        self._thread.join()
        for end in (self._wake, self._master, self._slave):
            os.close(end)
