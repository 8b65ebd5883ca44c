"""Make a delay trace for `link.trace` and `cogrip relay` of a recorded run: sending time and one-way delay of each datagram.

python docs/examples/record_a_trace.py RUN PERSON up|down > trace.csv

RUN holds the recordings of both ends (`cogrip merge` brings those of several machines together). A datagram is identified
by its bytes: each has a stamp of its own. The first of several copies counts. What never arrived is lost; what was sent
after the newest datagram that arrived is left out.
"""

import sys

from cogrip.protocol.recording.reader import RecordingError
from cogrip.protocol.wire.messages import MalformedError, Partner, Power, State, Waves, decode
from cogrip.results.reading.records import open_run

USAGE = "usage: record_a_trace.py RUN PERSON up|down"


class NoTraceError(Exception):
    """The trace cannot be made. The text says why."""


def trace(folder: str, person: str, direction: str) -> list[tuple[float, float | None]]:
    """Return (t_s, delay_ms) of each frame's datagram that was sent, delay_ms None where it was lost.

    Raises NoTraceError.
    """
    if direction not in ("up", "down"):
        raise NoTraceError(f"{direction!r} is no direction: up is from the client to the server, down is back")
    run = open_run(folder)
    if person not in run.clients:
        raise NoTraceError(f"{folder}: no recording of {person!r}; there is: {', '.join(run.clients) or 'nobody'}")
    if run.server is None:
        raise NoTraceError(f"{folder}: no recording of the server; bring both together by `cogrip merge`")
    client, server = run.clients[person], run.server
    sender, receiver = (client, server) if direction == "up" else (server, client)
    arrived: dict[bytes, float] = {}
    for time_s, datagram in receiver.records("datagram_in"):
        arrived.setdefault(datagram.data, time_s)
    session = next((message.session for _, _, message in frames(client)), None)  # the person's first one
    rows: list[tuple[float, float | None]] = []
    known = 0  # rows up to the newest that arrived
    for time_s, data, message in frames(sender):
        if message.session == session and (not rows or time_s > rows[-1][0]):
            at_s = arrived.get(data)
            rows.append((time_s, None if at_s is None else max(0.0, (at_s - time_s) * 1e3)))
            known = known if at_s is None else len(rows)
    if not known:
        raise NoTraceError(f"{folder}: nothing of {person} {direction} arrived, so that there is no delay")
    return rows[:known]


def frames(end):
    """Yield (time_s, bytes, message) of each datagram that this end sent once a frame."""
    for time_s, datagram in end.records("datagram_out"):
        try:
            message = decode(datagram.data)
        except MalformedError:
            continue
        if isinstance(message, Waves | State | Power | Partner):
            yield time_s, datagram.data, message


def main(arguments: list[str]) -> int:
    try:
        if len(arguments) != 3:
            raise NoTraceError(USAGE)
        rows = trace(*arguments)
    except (NoTraceError, RecordingError, OSError) as error:
        print(error, file=sys.stderr)
        return 2
    begin_s = rows[0][0]
    print("t_s,delay_ms")
    for time_s, delay_ms in rows:
        print(f"{time_s - begin_s:.9f},{'' if delay_ms is None else f'{delay_ms:.3f}'}")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
