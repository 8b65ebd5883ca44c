"""Buttons that a simulated hand presses by schedule: `press=1@2.0+0.3,2@2.1+0.1`."""

import re
from dataclasses import dataclass

from cogrip.devices.device import DeviceError
from cogrip.protocol.wire.handle import MOST_BUTTONS

MOST_S = 1e6
_ITEM = re.compile(r"(\d{1,2})@(\d{1,7}(?:\.\d{1,9})?)\+(\d{1,7}(?:\.\d{1,9})?)", re.ASCII)


@dataclass(frozen=True, slots=True)
class Press:
    """One press of a button, from 1: from `start_s` on for `hold_s`."""

    button: int
    start_s: float
    hold_s: float

    def ticks(self, rate_hz: int) -> range:
        """Return the ticks at which the button is down: at least one."""
        first = round(self.start_s * rate_hz)
        return range(first, max(first + 1, round((self.start_s + self.hold_s) * rate_hz)))


def read_presses(text: str, where: str) -> tuple[Press, ...]:
    """Return the presses in a text. Raises DeviceError."""
    presses = []
    for item in text.split(",") if text else ():
        found = _ITEM.fullmatch(item)
        press = Press(int(found[1]), float(found[2]), float(found[3])) if found else None
        if press is None or not 1 <= press.button <= MOST_BUTTONS or max(press.start_s, press.hold_s) > MOST_S:
            raise DeviceError(
                f"{where}: press={item!r}: write BUTTON@START_S+HOLD_S, such as press=1@2.0+0.3, with a button from 1 to"
                f" {MOST_BUTTONS} and times up to {MOST_S:g} s; commas between several"
            )
        presses.append(press)
    return tuple(presses)
