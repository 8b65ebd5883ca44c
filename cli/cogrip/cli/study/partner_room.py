"""Answers of `cogrip feel` and `stability` on models of partners: stiffness at rest, and a loop gain in place of a model.

An energy gate is not linear, so no spectral radius is told. Below a loop gain of 1 no delay makes hands swing, even without
gates (theory 5b, `cogrip.analysis.linear.partner_loop`).
"""

from typing import Any

from rich.table import Table

from cogrip.analysis.advice.partner_advice import HANDS_NPM, partner_loop
from cogrip.cli.terminal.output import Json, make_console, write_json
from cogrip.cli.terminal.problem import BadInput
from cogrip.cli.terminal.tables import say
from cogrip.devices.device import DeviceError
from cogrip.protocol.settings.sections import Settings

NOTE = "models of partners are not linear: no spectral radius; gates bound the energy of hands that swing"


def tell_partners(settings: Settings, json: Json, where: str) -> int:
    """Print, for hands of several stiffnesses, what they feel of each other at rest, and their loop gain."""
    if settings.object.traits.scene:
        raise BadInput(f"{where}: copies of a scene have no linear model; try them with `cogrip lab`")
    if len(settings.users) < 2:
        raise BadInput(f"{where}: one person alone has no partner to model; give users a second one")
    with BadInput.of(DeviceError, where=f"{where}: "):
        loop = partner_loop(settings)
    rows = [{"hand_npm": hand, "felt_npm": loop.felt_npm(hand), "loop_gain": loop.worst(hand)} for hand in HANDS_NPM]
    if json:
        answer: dict[str, Any] = {"people": loop.people, "spring_npm": loop.spring_npm, "hands": rows, "note": NOTE}
        write_json(answer, json)
        return 0
    console = make_console()
    table = Table(title=f"{loop.people} people, models of partners, at any delay")
    for column in ("all hands of (N/m)", "felt at rest (N/m)", "loop gain", ""):
        table.add_column(column, justify="right" if column else "left")
    for row in rows:
        calm = row["loop_gain"] < 1.0
        table.add_row(
            f"{row['hand_npm']:g}", f"{row['felt_npm']:.4g}", f"{row['loop_gain']:.2f}",
            "stable at any delay" if calm else "may swing",
        )  # fmt: skip
    console.print(table)
    say(console, f"({NOTE})")
    return 0
