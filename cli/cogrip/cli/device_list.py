"""`cogrip devices list`: what there is to hold."""

from collections.abc import Callable
from math import isinf

from rich.console import Console
from rich.table import Table

from cogrip.devices.device import Capability
from cogrip.devices.registry import describe, families

_ROWS: dict[str, Callable[[Capability], str]] = {
    "axes": lambda record: str(record.axes),
    "workspace": lambda record: "\n".join(f"{low * 1e3:g} to {high * 1e3:g} mm" for low, high in record.workspace_m),
    "peak force": lambda record: _number(record.peak_force_n, "N"),
    "continuous force": lambda record: _number(record.continuous_force_n, "N"),
    "advised stiffness": lambda record: _number(record.stiffness_npm, "N/m"),
    "advised damping": lambda record: _number(record.damping_nspm, "N s/m"),
    "force slope": lambda record: _number(record.slew_nps, "N/s"),
    "speed limit": lambda record: _number(record.speed_mps, "m/s"),
    "resolution": lambda record: "exact" if not record.resolution_m else _number(record.resolution_m * 1e3, "mm"),
    "apparent mass": lambda record: _number(record.apparent_mass_kg, "kg"),
    "highest rate": lambda record: _number(record.rate_hz, "Hz"),
    "gives velocity": lambda record: "yes" if record.gives_velocity else "no, it is estimated",
}


def device_list(*, axes: int = 3) -> int:
    """List the devices that can be named by address, with their capability records.

    Parameters
    ----------
    axes
        How many axes to make them with, 1 to 3.
    """
    listings = describe(axes=axes)
    table = Table(title="devices by address")
    table.add_column("record")
    for listing in listings:
        table.add_column(listing.address)
    for name, text in _ROWS.items():
        table.add_row(name, *[text(listing.capability) for listing in listings])
    console = Console()
    console.print(table)
    for scheme, summary in families().items():
        console.print(f"{scheme}: {summary}", highlight=False)
    return 0


def _number(value: float, unit: str) -> str:
    return "no limit named" if isinf(value) else f"{value:.4g} {unit}"
