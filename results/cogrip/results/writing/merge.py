"""Recordings of one run from several machines, brought together on the server's clock.

Each machine reads its steady clock against UTC once a second (`Clock`), which gives theta = server's clock - client's
clock as far as the machines agree on UTC. The datagrams that both ends recorded bound theta, whatever the network did:

    up    t_server(in) - t_client(out) = theta + delay >= theta
    down  t_client(in) - t_server(out) = -theta + delay >= -theta

so -min(down) <= theta <= min(up). An anchor inside these bounds is taken; else the middle, and what UTC is out by is said.
"""

import json
import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median_low

import msgspec

from cogrip.protocol.recording.folder import recordings_of
from cogrip.protocol.recording.reader import Recording, RecordingError, open_recording
from cogrip.protocol.recording.records import Clock, Datagram, kind_of
from cogrip.results.reading.folder import CLOCKS, SETTINGS, SUMMARY, write_summary
from cogrip.results.verdict.gates import judge_gates

_datagram = msgspec.json.Decoder(Datagram).decode
_clock = msgspec.json.Decoder(Clock).decode


@dataclass(frozen=True, slots=True)
class Alignment:
    """add_ns to a recording's clock gives the server's; the truth is between least_ns and most_ns, whatever the network did."""

    file: str
    add_ns: int
    least_ns: int
    most_ns: int
    by: str


@dataclass(frozen=True, slots=True)
class _Traffic:
    """A recording's datagrams by their bytes, and UTC - clock."""

    sent: dict[int, int]
    received: dict[int, int]
    utc_ns: int | None


def merge(folders: Sequence[Path], out: Path) -> list[Alignment]:
    """Copy the recordings of `folders` into the new folder `out` and find their clocks.

    Raises RecordingError where there is no server's part, two parts of one person, or parts of different runs;
    FileExistsError if `out` exists.
    """
    files = list({file.resolve(): file for folder in folders for file in recordings_of(folder)}.values())
    recordings = [open_recording(file) for file in files]
    servers = [each for each in recordings if each.header.role == "server"]
    if len(servers) != 1:
        what = "none" if not servers else ", ".join(str(each.path) for each in servers)
        raise RecordingError(f"a run has one server, and here is {what}; name its folder and those of its clients")
    people = [each.header.who for each in recordings if each.header.role == "client"]
    for name in people:
        if people.count(name) > 1:
            raise RecordingError(f"{name!r} is recorded {people.count(name)} times; merge the parts of one run only")
    names = [file.name for file in files]
    for file in files:
        if names.count(file.name) > 1:
            raise RecordingError(
                f"there are several files {file.name}; rename all but one, so that none is written over another"
            )
    here = _traffic(servers[0])
    alignments = [_align(each, _traffic(each), here) for each in recordings if each is not servers[0]]
    out.mkdir(parents=True)
    for file in files:
        shutil.copy2(file, out / file.name)
    for folder in sorted(
        folders, key=lambda each: each.resolve() != servers[0].path.parent.resolve()
    ):  # the server's first
        for name in (SUMMARY, SETTINGS):
            if (folder / name).is_file() and not (out / name).exists():
                shutil.copy2(folder / name, out / name)
    table = {
        each.file: {"add_ns": each.add_ns, "least_ns": each.least_ns, "most_ns": each.most_ns, "by": each.by}
        for each in alignments
    }
    (out / CLOCKS).write_text(json.dumps(table, indent=1) + "\n")
    _judge(out)
    return alignments


def _judge(out: Path) -> None:
    """Judge again what recordings of all people together tell."""
    try:
        summary = json.loads((out / SUMMARY).read_bytes())
    except (OSError, ValueError):
        return
    if isinstance(summary, dict) and judge_gates(out, summary):
        write_summary(out, summary)


def _traffic(recording: Recording) -> _Traffic:
    kinds = [kind_of(topic) for topic in recording.topics]
    sent: dict[int, int] = {}
    received: dict[int, int] = {}
    anchors: list[int] = []
    for message in recording.messages():
        kind = kinds[message.topic]
        if kind == "datagram_out":
            sent.setdefault(hash(_datagram(message.payload).data), message.time_ns)
        elif kind == "datagram_in":
            received.setdefault(hash(_datagram(message.payload).data), message.time_ns)
        elif kind == "clock":
            anchor = _clock(message.payload)
            anchors.append(anchor.utc_ns - anchor.monotonic_ns)
    return _Traffic(sent, received, median_low(anchors) if anchors else None)


def _align(recording: Recording, client: _Traffic, server: _Traffic) -> Alignment:
    up = [server.received[key] - at for key, at in client.sent.items() if key in server.received]
    down = [at - server.sent[key] for key, at in client.received.items() if key in server.sent]
    if not up or not down:
        raise RecordingError(
            f"{recording.path} and the server's recording have no datagrams in common; they are not of one run"
        )
    least, most = -min(down), min(up)
    file = recording.path.name
    if client.utc_ns is not None and server.utc_ns is not None:
        theta = client.utc_ns - server.utc_ns
        if least <= theta <= most:
            return Alignment(file, theta, least, most, "clock anchors")
        out_ms = min(abs(theta - least), abs(theta - most)) * 1e-6
        by = f"datagrams; the machines' UTC clocks are out by {out_ms:.1f} ms or more"
        return Alignment(file, (least + most) // 2, least, most, by)
    return Alignment(file, (least + most) // 2, least, most, "datagrams; there are no clock anchors")
