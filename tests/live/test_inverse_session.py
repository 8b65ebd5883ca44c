"""A live session with an Inverse3 behind an emulated service, another process with a real websocket."""

import signal

import pytest

from tests import forked
from tests.live.held_arms import Spoken, fairly, until


@pytest.fixture
def service(start):
    process = Spoken("devices", "emulate", "inverse", "--hand", "reach&amplitude_m=0.02")
    forked.never_late(process.popen)
    start.all.append(process)
    return process


@fairly
def test_a_killed_service_releases_the_force_and_is_re_armed_when_it_is_back(start, session, service):
    address = f"inverse:{service.hear(r'behind inverse:([^;]+);')[1]}"
    anna = session.join("anna", address, "--rearm")

    def pushes() -> bool:
        service.tell("status")
        return float(service.hear(r"pushes with \(([^)]*)\) N")[1].split(", ")[0]) != 0.0

    until(pushes, "the service's device pushes", company=[service, anna])
    service.tell("unplug")
    assert "lost the service" in anna.hear(r"fault, force released: (.*)")[1]
    assert not pushes()
    anna.popen.send_signal(signal.SIGUSR1)
    assert "start Haply's Inverse service" in anna.hear("not re-armed: (.*)")[1]
    service.tell("mend")
    service.hear("plugged in again")
    anna.popen.send_signal(signal.SIGUSR1)
    anna.hear("re-armed: force ramps in")
    until(pushes, "the service's device pushes again", company=[service, anna])
    session.close(anna)
    assert not pushes()
    assert session.summary("anna")["server"]["dropped"]["fault"] == 1
