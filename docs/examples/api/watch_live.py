"""Run the demo live, as processes of this machine, and follow the object while it moves."""

import cogrip.api as cogrip

seen: list[cogrip.Frame] = []
with cogrip.Session("demo", seconds=2.0, on_frame=seen.append) as session:
    run = session.wait()

shown = seen[:: max(1, len(seen) // 6)]
for frame in shown:
    hands = ", ".join(f"{name} {hand.force_n[0]:+.2f} N" for name, hand in frame.hands.items())
    print(f"{frame.time_s:5.2f} s  object at {frame.object_m[0] * 1e3:+6.2f} mm  {hands}")
print(f"{len(seen)} views; good: {run.good}; files in {run.folder}")
