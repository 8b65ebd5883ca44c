"""cogrip from Python: run sessions, read what they leave, watch live ones, and hold the object with a device of your own.

    import math

    import cogrip.api as cogrip

    run = cogrip.run("demo", seconds=5.0, coupling={"stiffness_npm": 800.0})     # in virtual time
    print(run.good, run.columns("anna", "position_m", "force_n")["force_n"].max())

    with cogrip.Session("demo", seconds=1.0, on_frame=print) as session:         # live: server and people as processes
        run = session.wait()

    with cogrip.Session("demo", seconds=1.0, mine=["ben"]) as session:           # live: with a device of your own
        device = cogrip.device_of(lambda time_s, force_n: (0.01 * math.sin(time_s),))
        account = cogrip.Client(session.address, device, name="ben", seconds=1.0).run()

Units are SI and stand in names. Every error that its user can mend is an `ApiError`. docs/api.md has the guide.
"""

from cogrip.api.administration import Administration, AsyncAdministration
from cogrip.api.client import Client, device_of
from cogrip.api.errors import ApiError
from cogrip.api.frames import Frame, HandState
from cogrip.api.runs import Run, open_run, run
from cogrip.api.session import Session, watch
from cogrip.api.settings import settings
from cogrip.devices.device import Capability, Device, DeviceError, Sample
from cogrip.devices.family.simulated import register_hand
from cogrip.devices.simulated.hands import Hand
from cogrip.protocol.settings.sections import Settings

__all__ = [
    "Administration", "ApiError", "AsyncAdministration", "Capability", "Client", "Device", "DeviceError", "Frame", "Hand",
    "HandState", "Run", "Sample", "Session", "Settings", "device_of", "open_run", "register_hand", "run", "settings",
    "watch",
]  # fmt: skip
