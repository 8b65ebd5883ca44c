"""Runs in virtual time that tests look at."""

from pathlib import Path
from typing import Any

from cogrip.protocol.settings.room import resolve
from cogrip.results.writing.laboratory_run import run_laboratory

PEOPLE = (
    {"name": "anna", "hand": "reach&direction=1,0.5,-0.3"},
    {"name": "ben", "device": "sim:ideal", "hand": "tremor&direction=0.2,1,1&seed=3", "side": "right"},
    {"name": "clara", "hand": "reach&direction=0.5,-0.5,0.4"},
)


def recorded_run(folder: Path, seconds: float, people: int = 2, **settings: Any) -> Path:
    """Record a session on three axes over a link that loses datagrams, in the new folder `folder`."""
    folder.mkdir()
    link = {"delay_ms": 20, "jitter_ms": 3, "loss": 0.05}
    users = list(PEOPLE[:people])
    table = {"name": "demo", "seconds": seconds, "object": {"axes": 3}, "link": link, "users": users, **settings}
    run_laboratory(resolve(table), folder)
    return folder
