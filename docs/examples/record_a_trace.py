"""From a recorded run to a delay trace that `link.trace` and `cogrip relay` play: who was sent what when, and when it came.

python docs/examples/record_a_trace.py RUN PERSON up|down > trace.csv

RUN holds the recordings of both ends (`cogrip merge` brings those of several machines together). A datagram is known
again by its bytes: each has a stamp of its own. Of copies the first counts; what never came is lost.
"""

import sys

from cogrip.protocol.messages import MalformedError, State, Waves, decode
from cogrip.sim.records import open_run


def trace(folder: str, person: str, way: str) -> list[tuple[float, float | None]]:
    """(t_s, delay_ms) of each wave or state that was sent, delay_ms None where it was lost."""
    run = open_run(folder)
    client, server = run.clients[person], run.server
    if server is None:
        raise SystemExit(f"{folder}: there is no recording of the server; bring both together by `cogrip merge`")
    sender, receiver = (client, server) if way == "up" else (server, client)
    came: dict[bytes, float] = {}
    for time_s, datagram in receiver.records("datagram_in"):
        came.setdefault(datagram.data, time_s)
    session = session_of(client)
    rows: list[tuple[float, float | None]] = []
    for time_s, datagram in sender.records("datagram_out"):
        try:
            message = decode(datagram.data)
        except MalformedError:
            continue
        if isinstance(message, Waves | State) and message.session == session and (not rows or time_s > rows[-1][0]):
            at_s = came.get(datagram.data)
            rows.append((time_s, None if at_s is None else max(0.0, (at_s - time_s) * 1e3)))
    return rows


def session_of(client) -> int:
    """The session this person's seat was in first."""
    return next(
        message.session
        for _, each in client.records("datagram_out")
        if isinstance(message := decode(each.data), Waves | State)
    )


if __name__ == "__main__":
    rows = trace(*sys.argv[1:4])
    begin_s = rows[0][0]
    print("t_s,delay_ms")
    for time_s, delay_ms in rows:
        print(f"{time_s - begin_s:.9f},{'' if delay_ms is None else f'{delay_ms:.3f}'}")
