"""Query keys of a recorded hand. They stand by themselves: what plays it imports numpy, and a list of devices needs none."""

from typing import Literal

from cogrip.devices.settings import Finite, NotNegative, Positive
from cogrip.devices.simulated.hands import ImpedanceSettings


class RecordedSettings(ImpedanceSettings, frozen=True, kw_only=True):
    """Query keys of `csv`; `time` to `origin` are those of a replayed table too (`TableSettings`).

    time, x, y, z   column names, `x [mm]` or only `x`; axes without a column do not move
    scale           metres per unit of the position columns; else the unit in the column's name says
    time_scale      seconds per unit of the time column; else the unit in its name says
    where           column:value, keep only the rows whose cell is that text
    origin          start: home plus the motion relative to its first sample; keep: positions as recorded
    start_s         the recording's first sample is played then (to the nearest tick); before, the hand rests there
    loop            0: rest at the last sample after the end; 1: return to the first in RETURN_S and play again
    """

    time: str
    x: str
    y: str | None = None
    z: str | None = None
    scale: Finite | None = None
    time_scale: Positive | None = None
    where: str | None = None
    origin: Literal["start", "keep"] = "start"
    start_s: NotNegative = 0.0
    loop: bool = False
