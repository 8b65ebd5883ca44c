"""Close two loops around a live session: a softer spring through long delays, a trial that ends when the object is still."""

import time

import cogrip.api as cogrip

SOFT_NPM, STIFF_NPM = 300.0, 900.0  # beyond 20 ms, and below
STILL_MPS, STILL_S = 0.002, 0.5  # the object is still when it has been slower for so long

set_to: dict[str, float] = {}
hold = "reach&stop_s=6"  # simulated people reach for six seconds, then hold still
with cogrip.Session("demo", seconds=20.0, users={0: {"hand": hold}, 1: {"hand": hold}}) as session:
    for _ in range(2):
        session.wait_for("joined", seconds=30.0)
    session.mark("trial 1 begins")
    still_since = time.monotonic()
    while time.monotonic() - still_since < STILL_S:
        for person in session.who():
            wanted = SOFT_NPM if (person.rtt_ms or 0.0) > 20.0 else STIFF_NPM
            if set_to.get(person.name) != wanted:
                print(session.set(person.name, stiffness_npm=wanted))
                set_to[person.name] = wanted
        (room,) = session.administration.rooms()
        if room.speed_mps > STILL_MPS:
            still_since = time.monotonic()
        time.sleep(0.05)
    session.mark("trial 1 ends")
    session.stop()
    run = session.wait()

print([text for _, text in run.markers])
print(f"asked for at the end: {[user['asked_stiffness_npm'] for user in run.summary['users']]} N/m; good: {run.good}")
