"""Compare what two people feel at three delays, in virtual time: a table from numpy columns."""

import numpy as np

import cogrip.api as cogrip

print("delay    peak force   stretch between the hands")
for delay_ms in (0.0, 20.0, 60.0):
    run = cogrip.run("demo", seconds=2.5, link={"delay_ms": delay_ms})
    assert run.good, run.summary
    anna, ben = (run.columns(name, "position_m", "force_n") for name in run.people)
    force_n = np.linalg.norm(anna["force_n"], axis=1).max()
    apart_m = np.abs(anna["position_m"][:, 0] - ben["position_m"][:, 0]).max()
    print(f"{delay_ms:3.0f} ms {force_n:9.2f} N {apart_m * 1e3:12.1f} mm")
