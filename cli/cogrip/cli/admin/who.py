"""`cogrip who`: everyone who is seated or observes in a running server."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from rich.table import Table

from cogrip.cli.admin.state_folder import Port, State, answer_of, check_words
from cogrip.cli.session.loopback import is_loopback
from cogrip.cli.terminal.output import Json, make_console, write_json
from cogrip.cli.terminal.problem import BadInput
from cogrip.cli.terminal.tables import Fitted, clock, columns_table
from cogrip.protocol.settings.coupling_kinds import GATE_MJ
from cogrip.protocol.texts import shown
from cogrip.protocol.wire.join_link import DEFAULT_PORT
from cogrip.server.administration.orders import MOST_WORD, WhoOrder
from cogrip.server.admission.roster import RosterEntry

_HEADINGS = ("name", "room", "seat", "address", "since", "rtt ms", "up ms", "down ms", "lost", "device")
_SHORT = {"name": 16}
_NUMBERS = ("rtt ms", "up ms", "down ms", "lost")
_PIPED_WIDTH = 10_000  # width of the table in a pipe: one line for each row


def who(
    server: str = "", /, *, room: str = "", state: State = None, port: Port = DEFAULT_PORT, json: Json = None
) -> int:
    """List who is seated or observes in a running server.

    With the time since they joined, address, round trip, delays and losses; below, what is set of their hands. Exit code 1
    where the server does not run.

    Parameters
    ----------
    server
        HOST:PORT of the server, as other commands take it, in place of --port; it must run on this machine.
    room
        Of this room only.
    """
    check_words("who: --room", room, MOST_WORD)
    if server:
        port = _number_here(server, state, port)
    answer, folder = answer_of("who", WhoOrder(room), state, port)
    if json is not None:
        people = [{name: getattr(each, name) for name in RosterEntry.__struct_fields__} for each in answer.people]
        write_json({"folder": str(folder), "people": people, "said": answer.text}, json)
        return 0
    console = make_console(soft_wrap=True, piped_width=_PIPED_WIDTH)
    if answer.people:
        console.print(people_tables(answer.people))
        for each in answer.people:
            if each.hand:
                console.print(f"{shown(each.name)}: {shown(each.hand)}")
            if each.gave_j is not None:
                console.print(f"{shown(each.name)}: {gate_words(each)}")
    console.print(answer.text)
    return 0


def gate_words(each: RosterEntry) -> str:
    """Return what the gate at a person's hand lends, as its client tells, and what was passed to and from it."""
    left = "not told" if each.gate_j is None else f"{1e3 * each.gate_j + GATE_MJ:z.1f} of {GATE_MJ:g} mJ left, it says"
    gave, got = (f"{1e3 * (value or 0.0):z.1f} mJ" for value in (each.gave_j, each.got_j))
    return f"gate: {left}; gave {gave} to the others, got {got}"


def _number_here(server: str, state: Path | None, port: int) -> int:
    """Return the port of a server of this machine. Raises BadInput for another machine, or where two ports are named."""
    if state is not None or port != DEFAULT_PORT:
        raise BadInput(f"who: {server} and --state or --port: give one of them")
    from cogrip.cli.session.join_target import target_of  # with all that joins a server

    target = target_of(server, "", insecure=True, name="", digest="")
    if not is_loopback(target.host):
        raise BadInput(
            f"who: {target.host} may be another machine, and who reads a server's own state folder: run it there, as "
            f"`ssh {target.host} cogrip who --port {target.port}`"
        )
    return target.port


def people_tables(people: Sequence[RosterEntry]) -> Fitted:
    """Return a row a person; where that is too wide, addresses stand in tables of their own, beside the names."""
    rows = [dict(zip(_HEADINGS, _cells(each), strict=True)) for each in people]
    whose = _HEADINGS[:2]
    session = tuple(heading for heading in _HEADINGS if heading not in ("address", "device"))

    def tables(*groups: Sequence[str], widest: Mapping[str, int] = {}) -> list[Table]:
        return [columns_table(group, rows, right=_NUMBERS, widest=widest) for group in groups]

    short = ("seat", "since", *_NUMBERS)
    return Fitted(
        lambda: tables(_HEADINGS),
        lambda: tables(session, (*whose, "address", "device")),
        lambda: tables(session, ("name", "address"), ("name", "device")),
        lambda: [*tables(whose), *tables(("name", *short), ("name", "address"), ("name", "device"), widest=_SHORT)],
    )


def _cells(each: RosterEntry) -> tuple[str, ...]:
    """Return the cells below _HEADINGS. Names and devices are escaped: peers choose them."""
    seat = "observes" if each.seat is None else f"{each.seat}" if each.holds else f"{each.seat} (comes)"
    directions = ["-" if value is None else f"{value:.1f}" for value in (each.rtt_ms, each.up_ms, each.down_ms)]
    return (
        shown(each.name), shown(each.room), seat, shown(each.address), clock(each.since_s), *directions,
        "-" if each.lost is None else f"{each.lost}", shown(each.device) or "-",
    )  # fmt: skip
