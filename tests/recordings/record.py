"""Record the sessions of this folder anew: `python3 dev.py rerecord`, when the behaviour is meant to change.

`laboratory`: virtual time, 3 axes, a bad link. `live`: real processes over UDP on loopback. The others: one of each scheme, in
virtual time over a bad link. All are verified before they take the place of the old ones.
"""

import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from cogrip.protocol.settings.room import resolve
from cogrip.results.reading.records import open_run
from cogrip.results.replay.verify import verify
from cogrip.results.writing.laboratory_run import run_laboratory

HERE = Path(__file__).resolve().parent
KEPT = (".mcap", "summary.json", "settings.json")

LABORATORY = {
    "name": "laboratory",
    "seed": 7,
    "seconds": 0.7,
    "object": {"axes": 3},
    "coupling": {"stiffness_npm": 1500.0},
    "link": {"delay_ms": 10, "jitter_ms": 5, "loss": 0.1, "duplicate": 0.05, "reorder": 0.05},
    "playout": {"frames": 2},
    "users": [
        {"name": "anna", "device": "sim:phantom?press=2@0.2+0.15,1@0.3+0.1", "hand": "reach&direction=1,0.5,-0.3"},
        {
            "name": "ben",
            "device": "sim:ideal",
            "hand": "tremor&tremor_m=0.002&direction=0.2,1,1&seed=3",
            "side": "right",
        },
    ],
}


SCHEMES: dict[str, dict[str, Any]] = {
    "coupling": {"coupling": {"kind": "coupling", "stiffness_npm": 300.0}},
    "tdpa": {"coupling": {"kind": "tdpa"}},
    "local": {"coupling": {"kind": "local"}, "object": {"kind": "wall", "axes": 1}},
    "partner": {"coupling": {"kind": "partner", "stiffness_npm": 1000.0}},
}


def laboratory(folder: Path) -> None:
    folder.mkdir()
    run_laboratory(resolve(LABORATORY), folder)


def of_scheme(folder: Path) -> None:
    """Record the scheme by which the folder is called."""
    given = SCHEMES[folder.name]
    users = [
        {"name": "anna", "hand": "reach&amplitude_m=0.02&stroke_s=0.3"},
        {"name": "ben", "hand": "hold", "side": "right"},
    ]
    folder.mkdir()
    run_laboratory(resolve({**LABORATORY, "name": folder.name, "object": {"axes": 1}, "users": users, **given}), folder)


def live(folder: Path) -> None:
    runs = folder.with_suffix(".runs")
    config = str(HERE.parents[1] / "configs" / "demo.toml")
    demo = [sys.executable, "-m", "cogrip.cli", "demo"]
    command = [*demo, "--config", config, "--seconds", "0.75", "--runs", str(runs)]
    # One second is too short to move the cube: exit code 1
    subprocess.run(command, check=False, stdout=subprocess.DEVNULL)
    (made,) = runs.iterdir()
    made.rename(folder)


def main(*names: str) -> int:
    """Record the sessions of these names; all of them without any."""
    with tempfile.TemporaryDirectory() as work:
        makers = {"laboratory": laboratory, "live": live, **dict.fromkeys(SCHEMES, of_scheme)}
        for name in names or makers:
            made = Path(work) / name
            makers[name](made)
            run = open_run(made)
            for end in (*run.clients.values(), run.server):
                if end is None or not verify(end.recording).exact:
                    print(f"{made.name} does not verify; nothing of it was kept", file=sys.stderr)
                    return 1
            kept = HERE / name
            shutil.rmtree(kept, ignore_errors=True)
            kept.mkdir()
            for path in sorted(made.iterdir()):
                if path.name.endswith(KEPT):
                    shutil.copy2(path, kept / path.name)
            print(f"recorded anew: {kept}")
    return 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
