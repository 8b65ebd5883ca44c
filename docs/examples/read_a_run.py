"""Read a recorded run from Python. Run it cell by cell in an editor that knows `# %%`, or whole:

python docs/examples/read_a_run.py [RUN]    the newest run in runs/ if none is named
"""

# %% Open a run: a folder, or one .mcap file. Damaged files are read up to the damage.
import sys
from pathlib import Path

import numpy as np

from cogrip.results.reading.records import open_run

newest = max(Path("runs").glob("*-*"), default=Path("runs"))  # their names begin with the time
run = open_run(sys.argv[1] if len(sys.argv) > 1 else newest)
print("people:", ", ".join(run.clients), "| notes:", run.notes or "none")

# %% Typed records, one by one: every topic has its struct in cogrip.protocol.recording.records.
name, end = next(iter(run.clients.items()))
for time_s, tick in end.records("tick"):
    if tick.tick % 1024 == 0:
        print(f"{time_s:7.3f} s  {tick.state:9} hand at {tick.position_m} m, force {tick.force_n} N")

# %% Columns as numpy arrays: shape (n,) or (n, axes), nan where a value is unknown.
columns = end.columns("tick", "position_m", "force_n", "work_j", "late_us")
force = np.linalg.norm(columns["force_n"], axis=1)
print(
    f"{name}: {len(force)} ticks, peak force {force.max():.2f} N, work by the hand {columns['work_j'][-1] * 1e3:.1f} mJ"
)
print(f"{name}: 99 of 100 ticks came within {np.percentile(columns['late_us'], 99):.0f} us of their time")

# %% The server's side of the same run, on the same clock.
gap_mm = [
    abs(step.seats[0].proxy_m[0] - step.object_m[0]) * 1e3
    for _, step in run.steps()
    if step.seats and step.seats[0].seated
]
if gap_mm:
    print(f"largest gap between {run.names()[0]}'s proxy and the object: {max(gap_mm):.2f} mm")

# %% Events, and datagrams that were sent.
if run.server is not None:
    for time_s, event in run.server.records("event"):
        print(f"{time_s:7.3f} s  {event.text}")
    sizes = [len(datagram.data) for _, datagram in run.server.records("datagram_out")]
    print(f"{len(sizes)} datagrams from the server, {np.mean(sizes):.0f} bytes on average")
