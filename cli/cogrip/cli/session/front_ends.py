"""Origins of the pages that may open a session for Foxglove's protocol."""

from typing import Annotated

from cyclopts import Parameter

from cogrip.cli.terminal.problem import BadInput
from cogrip.view.access import FRONT_ENDS, host_of

FoxgloveOrigins = Annotated[
    tuple[str, ...],
    Parameter(
        name="--foxglove-origin",
        negative="",
        help="Origin of a further page that may connect with --foxglove, such as https://lichtblick.example. Repeatable.",
    ),
]


def front_ends(foxglove: bool, origins: tuple[str, ...]) -> tuple[str, ...]:
    """Return the origins that may connect, none without `foxglove`. Raises BadInput."""
    if origins and not foxglove:
        raise BadInput("--foxglove-origin: goes with --foxglove")
    for origin in origins:
        if not host_of(origin):
            raise BadInput(
                f"--foxglove-origin {origin!r}: is no origin; write it as http://HOST, https://HOST or with :PORT, and no path"
            )
    return (*FRONT_ENDS, *origins) if foxglove else ()
