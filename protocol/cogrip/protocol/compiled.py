"""Report of the form in which cogrip runs: interpreted, or with the modules that `dev.py compile` has made."""

from collections.abc import Sequence
from types import ModuleType

from cogrip.protocol import button_edges, clock, histogram
from cogrip.protocol.line import energy_ledger, energy_sums, receiver, sender

LINE: Sequence[ModuleType] = (button_edges, clock, histogram, energy_ledger, energy_sums, receiver, sender)


def form() -> str:
    """Return "compiled", "interpreted", or "partly compiled" where a build was interrupted or is of an older source."""
    compiled = [not str(module.__file__).endswith(".py") for module in LINE]
    return "compiled" if all(compiled) else "partly compiled" if any(compiled) else "interpreted"
