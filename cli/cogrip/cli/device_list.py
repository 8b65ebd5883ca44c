"""`cogrip devices list`: what there is to hold."""

from collections.abc import Callable, Sequence
from typing import Any

import msgspec
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from cogrip.cli.json_answer import Json, write_json
from cogrip.cli.problem import BadInput
from cogrip.devices.device import Capability, DeviceError
from cogrip.devices.registry import FAMILIES, MOST_AXES, Listing, broken, describe, families, is_real
from cogrip.devices.settings import parse_address

NOT_RUN = "not yet run on hardware"

_COLUMNS: dict[str, Callable[[Capability], Sequence[str]]] = {
    "axes,\nworkspace": lambda record: (f"{record.axes} axes", *_workspace(record)),
    "force: peak,\nfor ever,\nslope": lambda record: (
        _number(record.peak_force_n, "N"), _number(record.continuous_force_n, "N"), _number(record.slew_nps, "N/s"),
    ),
    "advised:\nstiffness,\ndamping": lambda record: (
        _number(record.stiffness_npm, "N/m"), _number(record.damping_nspm, "N s/m"),
    ),
    "one count,\nfelt mass,\nown losses": lambda record: (
        _number(record.resolution_m * 1e3, "mm") if record.resolution_m else "exact", _number(record.apparent_mass_kg, "kg"),
        *([_number(record.own_damping_nspm, "N s/m")] if record.own_damping_nspm else []),
        *([_number(record.own_friction_n, "N")] if record.own_friction_n else []),
    ),
    "most speed,\nrate,\nvelocity": lambda record: (
        _number(record.speed_mps, "m/s"), _number(record.rate_hz, "Hz"),
        "is given" if record.gives_velocity else "estimated",
    ),
}  # fmt: skip


def device_list(*, axes: int = MOST_AXES, json: Json = None) -> int:
    """List the devices that can be named by address, with their capability records.

    Parameters
    ----------
    axes
        How many axes to make them with, 1 to 3.
    """
    if not 1 <= axes <= MOST_AXES:
        raise BadInput(f"--axes {axes} is outside 1 to {MOST_AXES}")
    try:
        listings, summaries = describe(axes=axes), families()
    except DeviceError as error:
        raise BadInput(str(error)) from None
    if json is not None:
        write_json(_as_json(listings, summaries), json)
        return 0
    console = Console(highlight=False)
    for scheme, summary in summaries.items():
        mark = f" ({NOT_RUN})" if _untried(scheme) else ""
        console.print(f"{scheme}: {summary}{mark}", markup=False, soft_wrap=True)
        rows = [listing for listing in listings if parse_address(listing.address).scheme == scheme]
        console.print(_table(rows) if rows else "")
    for text in broken().values():
        console.print(f"left out: {text}", markup=False, soft_wrap=True)
    console.print("`--json -` gives the records as they are.", markup=False, soft_wrap=True)
    return 0


def _untried(scheme: str) -> bool:
    """Of other packages' drivers nothing is known."""
    return scheme in FAMILIES and is_real(f"{scheme}:")


def _table(listings: Sequence[Listing]) -> Table:
    """A row a device."""
    table = Table(box=SIMPLE_HEAD, show_lines=True, padding=(0, 1, 0, 0))
    table.add_column("address", overflow="fold")
    for heading in _COLUMNS:
        table.add_column(heading, justify="right", no_wrap=True)
    for listing in listings:
        table.add_row(listing.address, *["\n".join(lines(listing.capability)) for lines in _COLUMNS.values()])
    return table


def _workspace(record: Capability) -> Sequence[str]:
    """One line, where it is the same along all axes."""
    lines = [
        f"±{high * 1e3:g} mm" if high == -low else f"{low * 1e3:g} to {high * 1e3:g} mm"
        for low, high in record.workspace_m
    ]
    return lines[:1] if len(set(lines)) == 1 else lines


def _number(value: float, unit: str) -> str:
    return f"{value:.4g} {unit}"


def _as_json(listings: Sequence[Listing], summaries: dict[str, str]) -> dict[str, Any]:
    """The records, field by field."""
    return {
        "families": {
            scheme: {"summary": summary, "real": is_real(f"{scheme}:"), "not_run_on_hardware": _untried(scheme)}
            for scheme, summary in summaries.items()
        },
        "devices": [
            {"address": listing.address, "real": is_real(listing.address), **msgspec.to_builtins(listing.capability)}
            for listing in listings
        ],
    }
