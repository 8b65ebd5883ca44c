"""[audio] of a study, on people's pages: a tone at the beginning of each phase, and noise that masks motors."""

from typing import Annotated, Literal

import msgspec

MOST_LEVEL = 0.5  # largest level, of full scale: tone and noise together stay within it
Level = Annotated[float, msgspec.Meta(ge=0.0, le=MOST_LEVEL)]


class Audio(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Off where nothing is said. tone_hz: 0 for none; noise: while a trial goes on; levels of full scale."""

    tone_hz: Annotated[float, msgspec.Meta(ge=0.0, le=10_000.0)] = 0.0
    tone_s: Annotated[float, msgspec.Meta(ge=0.05, le=2.0)] = 0.15
    tone_level: Level = 0.2
    noise: Literal["none", "white", "pink"] = "none"
    noise_level: Level = 0.1

    @property
    def wanted(self) -> bool:
        return self.tone_hz > 0.0 or self.noise != "none"
