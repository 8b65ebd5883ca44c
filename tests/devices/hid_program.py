"""Plays all scenarios on one backend of hidapi and prints, as JSON, what went wrong. It runs below `LD_PRELOAD`."""

import ctypes
import json
import sys
import traceback
from pathlib import Path

from cogrip.devices.io import hid_line

from tests.devices import hid_line_scenarios
from tests.devices.hid_bench import LONG_S, Bench

SCENARIOS = {
    name.removeprefix("scenario_"): play
    for name, play in vars(hid_line_scenarios).items()
    if name.startswith("scenario_")
}


def main(stub: str, backend: str, folder: str) -> None:
    library = ctypes.CDLL(stub)
    hid_line.CLOSE_S = LONG_S  # a busy machine may keep the last report waiting
    outcomes = {}
    for name, play in SCENARIOS.items():
        own = Path(folder) / name
        own.mkdir()
        bench = Bench(library, backend, own)
        outcomes[name] = ""
        try:
            play(bench)
            bench.close()
        except Exception:  # noqa: BLE001 - the test shows it
            outcomes[name] = traceback.format_exc()
    print(json.dumps(outcomes))


if __name__ == "__main__":
    main(*sys.argv[1:])
