"""Show a recorded run in Rerun (https://rerun.io): the object, hands and forces in 3D, and forces and delays over time.

pip install rerun-sdk
python docs/examples/rerun_a_run.py RUN [FILE.rrd]     opens the viewer, or writes a file for it
"""

import sys
from pathlib import Path

import numpy as np
import rerun

from cogrip.results.reading.columns import Array
from cogrip.results.reading.records import open_run

FORCE_M_PER_N = 0.01  # length of an arrow


def places(rows: Array) -> Array:
    """Return three numbers a row, 0 for axes that there are not."""
    return np.pad(rows[:, :3], ((0, 0), (0, max(0, 3 - rows.shape[1]))))


def points(path: str, times: list[rerun.TimeColumn], rows: Array) -> None:
    columns = rerun.Points3D.columns(positions=rows, radii=np.full(len(rows), 0.01))
    rerun.send_columns(path, times, columns)


run = open_run(sys.argv[1])
rerun.init("cogrip", spawn=len(sys.argv) < 3)
if len(sys.argv) > 2:
    rerun.save(Path(sys.argv[2]))

for name, end in run.clients.items():
    ticks = end.columns("tick", "position_m", "force_n", "rtt_ms")
    kept = np.isfinite(ticks["position_m"]).all(axis=1)
    times = [rerun.TimeColumn("run", duration=ticks["time_s"][kept])]
    hand, force = places(ticks["position_m"][kept]), places(ticks["force_n"][kept])
    points(f"hands/{name}", times, hand)
    arrows = rerun.Arrows3D.columns(origins=hand, vectors=-FORCE_M_PER_N * force)  # what the device pushes with
    rerun.send_columns(f"forces/{name}", times, arrows)
    rerun.send_columns(f"force_n/{name}", times, rerun.Scalars.columns(scalars=np.linalg.norm(force, axis=1)))
    known = np.isfinite(ticks["rtt_ms"])
    when = [rerun.TimeColumn("run", duration=ticks["time_s"][known])]
    rerun.send_columns(f"rtt_ms/{name}", when, rerun.Scalars.columns(scalars=ticks["rtt_ms"][known]))

if run.server is not None:
    steps = run.server.columns(f"/room/{run.room()}/step", "object_m")
    points("object", [rerun.TimeColumn("run", duration=steps["time_s"])], places(steps["object_m"]))
    for time_s, text in run.markers():
        rerun.set_time("run", duration=time_s)
        rerun.log("markers", rerun.TextLog(text))
