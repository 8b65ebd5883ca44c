"""An emulated device on a pseudo-terminal, as a serial port has it. The link shows to it, also when it changes."""

import os
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path

from cogrip.devices.emulated.firmware import Firmware
from cogrip.devices.io.platform import open_pseudo_terminal
from cogrip.devices.io.served_firmware import ServedFirmware


class PseudoTerminal(ServedFirmware):
    """See `ServedFirmware`."""

    def __init__(self, firmware: Firmware, link: Path | None, say: Callable[[str], None]) -> None:
        super().__init__(firmware, say)
        self._link = link
        self._master = self._slave = -1
        self._late = b""

    @property
    def where(self) -> str:
        return str(self._link or self.path)

    @property
    def plugged(self) -> bool:
        return self._master >= 0

    def plug(self) -> None:
        self._master, self._slave, self.path = open_pseudo_terminal()
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

    def sources(self) -> Sequence[int]:
        return [self._master] if self.plugged else []

    def received(self, ready: Sequence[int]) -> Sequence[bytes]:
        if self._master in ready:
            with suppress(OSError):  # nobody has it open
                return [os.read(self._master, 4096)]
        return []

    def tell(self, replies: Sequence[bytes]) -> None:
        self._late += b"".join(replies)
        if self._late and self.plugged:
            with suppress(BlockingIOError):  # nobody reads
                self._late = self._late[os.write(self._master, self._late) :]
            self._late = self._late[-4096:]
