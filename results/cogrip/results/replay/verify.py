"""Verification of a recording: its inputs go into the same core again, which records everything as it did then.

The new records must be those of the file, message for message and byte for byte.
"""

from dataclasses import dataclass

from cogrip.protocol.recording.header import versions_here
from cogrip.protocol.recording.reader import Damage, Recording, RecordingError
from cogrip.protocol.recording.records import Gap
from cogrip.results.replay.comparison import FirstDifference, ReplayComparison
from cogrip.results.replay.play import PLAYS, Play
from cogrip.results.replay.replay_input import ReplayInput, UntoldError


@dataclass(frozen=True, slots=True)
class ReplayVerdict:
    """The outcome of replaying one recording.

    messages, ticks  compared and equal; ticks of a client, steps of a server
    versions         what differs between the machine that recorded and this one
    hole             inputs are missing here: nothing after `hole_ns` could be compared
    cut              all that is there was compared, but the end is missing: its process was killed, or the file not closed
    """

    who: str
    start_ns: int
    messages: int
    ticks: int
    seconds: float
    difference: FirstDifference | None
    versions: tuple[str, ...]
    hole: Damage | Gap | None
    hole_ns: int | None
    cut: bool

    @property
    def exact(self) -> bool:
        return self.difference is None and self.hole is None


def verify(recording: Recording) -> ReplayVerdict:
    """Play a recording through a new core. Raises RecordingError for one that cannot be played."""
    header = recording.header
    if header.role not in PLAYS:
        raise RecordingError(f"{recording.path} is of a {header.role!r}; only {' and '.join(PLAYS)} can be replayed")
    replay_input, comparison = ReplayInput(recording), ReplayComparison(recording.topics)
    try:
        play = PLAYS[header.role](replay_input, comparison)
        _compare(replay_input, play, comparison)
    except (KeyError, ValueError, TypeError, IndexError) as error:
        raise RecordingError(f"{recording.path} cannot be replayed: {error}") from error
    first_ns = replay_input.first_ns if replay_input.first_ns is not None else replay_input.last_ns
    return ReplayVerdict(
        header.who, first_ns, comparison.equal, play.ticks, (replay_input.last_ns - first_ns) * 1e-9, comparison.difference,
        tuple(header.versions.differences(versions_here())), replay_input.hole, replay_input.hole_ns, replay_input.cut,
    )  # fmt: skip


def _compare(replay_input: ReplayInput, play: Play, comparison: ReplayComparison) -> None:
    try:
        for message in replay_input:
            comparison.expect(message)
            play.take(message)
            if comparison.difference is not None:
                return
        if replay_input.whole:  # else neither the next input nor the end of the last ones is known
            play.finish()
            comparison.finish()
    except UntoldError:
        if replay_input.whole:
            comparison.untold(replay_input.last_ns, f"/{replay_input.recording.header.who}/answer")
