"""Playback of a recorded view by a clock that is handed in: play, pause, seek, speed, loop."""

from collections.abc import Callable, Sequence
from math import isfinite
from typing import Literal

from cogrip.view.frames import SceneFrame
from cogrip.view.recording import CHUNK_S

Status = Literal["playing", "paused", "ended"]
LEAST_SPEED, MOST_SPEED = 0.1, 10.0
TURN_S = 1.0 / 60.0  # time between two looks at the clock
MOST_FRAMES = 16  # most frames at once: of more, every n-th is shown
_CAUGHT_UP_S = 1.0  # longest gap in the clock that is caught up with; of a longer one only the end is shown


class Playback:
    """Plays frames of chunks 0 to `chunks`, which `frames_of` returns. Times are those of the view, `now_s` any steady clock's.

    It begins paused at 0. At the end it stays there; `play` then begins anew.
    """

    def __init__(self, frames_of: Callable[[int], Sequence[SceneFrame]], chunks: int, duration_s: float) -> None:
        self._frames_of, self._chunks, self._duration_s = frames_of, chunks, duration_s
        self._from_s = 0.0  # place at `_since_s`
        self._since_s: float | None = None  # None: paused
        self._shown_s: float | None = None  # time up to which frames were given; None: not even the one here
        self.speed = 1.0
        self.range_s: tuple[float, float] | None = None

    def place_s(self, now_s: float) -> float:
        """Return the time of the view that is shown now."""
        if self._since_s is None:
            return self._from_s
        place_s = self._from_s + max(0.0, now_s - self._since_s) * self.speed
        if self.range_s and place_s >= self.range_s[1]:
            begin_s, end_s = self.range_s
            return begin_s + (place_s - end_s) % (end_s - begin_s)
        return min(place_s, self._duration_s)

    def status(self, now_s: float) -> Status:
        if self._since_s is None:
            return "paused"
        return "ended" if self.range_s is None and self.place_s(now_s) >= self._duration_s else "playing"

    def play(self, now_s: float) -> None:
        """Go on; from the end, begin anew."""
        if self.status(now_s) == "ended" or self.place_s(now_s) >= self._duration_s:
            self.seek(0.0, now_s)
        self._from_s, self._since_s = self.place_s(now_s), now_s

    def pause(self, now_s: float) -> None:
        self._from_s, self._since_s = self.place_s(now_s), None

    def seek(self, place_s: float, now_s: float) -> None:
        """Go to a time of the view, the nearest that is there. Raises ValueError for one that is not finite."""
        if not isfinite(place_s):
            raise ValueError(f"{place_s} is no time; give seconds from 0 to {self._duration_s:g}")
        self._from_s = min(max(0.0, place_s), self._duration_s)
        self._since_s = None if self._since_s is None else now_s
        self._shown_s = None

    def set_speed(self, speed: float, now_s: float) -> None:
        """Set the speed, within LEAST_SPEED and MOST_SPEED. Raises ValueError for one that is not above 0."""
        if not (isfinite(speed) and speed > 0.0):
            raise ValueError(f"a speed of {speed} cannot be had; give {LEAST_SPEED:g} to {MOST_SPEED:g}")
        self._from_s = self.place_s(now_s)
        self._since_s = None if self._since_s is None else now_s
        self.speed = min(max(LEAST_SPEED, speed), MOST_SPEED)

    def loop(self, range_s: tuple[float, float] | None, now_s: float) -> None:
        """Play a range again and again; None: no more. Raises ValueError for a range in which there is nothing."""
        if range_s is not None:
            begin_s, end_s = range_s
            if not 0.0 <= begin_s < end_s <= self._duration_s:
                raise ValueError(f"{begin_s:g} to {end_s:g} s is no range within 0 to {self._duration_s:g} s")
        self._from_s = self.place_s(now_s)
        self._since_s = None if self._since_s is None else now_s
        self.range_s = range_s
        if range_s and not range_s[0] <= self._from_s < range_s[1]:
            self.seek(range_s[0], now_s)

    def due(self, now_s: float) -> list[SceneFrame]:
        """Return the frames since the last call; after a jump, the one that is shown there."""
        place_s = self.place_s(now_s)
        shown_s, self._shown_s = self._shown_s, place_s
        if shown_s is None:
            return self._here(place_s)
        if place_s < shown_s:  # it began the loop anew
            shown_s = self.range_s[0] if self.range_s else 0.0
        begin_s = max(shown_s, place_s - _CAUGHT_UP_S * self.speed)
        found = [
            frame
            for number in range(int(begin_s // CHUNK_S), min(int(place_s // CHUNK_S), self._chunks - 1) + 1)
            for frame in self._frames_of(number)
            if begin_s < frame.time_s <= place_s
        ]
        every = -(-len(found) // MOST_FRAMES) or 1
        return found[::-1][::every][::-1]  # the newest in any case

    def _here(self, place_s: float) -> list[SceneFrame]:
        """Return the newest frame at a time, or the first there is."""
        for number in range(min(int(place_s // CHUNK_S), self._chunks - 1), -1, -1):
            before = [frame for frame in self._frames_of(number) if frame.time_s <= place_s]
            if before:
                return before[-1:]
        return list(self._frames_of(0)[:1])

    def wanted(self, now_s: float) -> tuple[int, ...]:
        """Return the chunks that are needed now and soon, so that another thread may read them before they are."""
        now = min(int(self.place_s(now_s) // CHUNK_S), self._chunks - 1)
        after = int(self.range_s[0] // CHUNK_S) if self.range_s and (now + 1) * CHUNK_S > self.range_s[1] else now + 1
        return (now, after) if after < self._chunks and after != now else (now,)

    def show_again(self) -> None:
        """Give the frame that is shown now once more: somebody began to look."""
        self._shown_s = None

    def next_s(self, now_s: float) -> float | None:
        """Return when `due` wants to be called next; None: not before something is asked for."""
        shown = self._shown_s == self.place_s(now_s)  # also what was played just before it paused or ended
        return None if shown and self.status(now_s) != "playing" else now_s + TURN_S
