"""The damper of a seat and what its device carries: nothing is driven beyond that, whatever a server sends."""

from dataclasses import replace

import pytest

from cogrip.client.core import ClientCore
from cogrip.client.hand.velocity import largest_impedance
from cogrip.client.inputs import Connect
from cogrip.client.safety.rendered_damper import OverloadError, refusal, rounded_down
from cogrip.client.supervised_device import SupervisedDevice
from cogrip.devices.device import Capability
from cogrip.devices.registry import make
from cogrip.devices.simulated.simulated_device import SimulatedDevice
from cogrip.protocol.settings.seat import SeatSettings

from tests.client.seated_client import T_C, hello, seat, welcome


def asked(**coupling: object) -> SeatSettings:
    return seat(coupling={"impedance_nspm": 20.0, **coupling})


def phantom() -> SimulatedDevice:
    device = make("sim:phantom?hand=hold")
    assert isinstance(device, SimulatedDevice)
    return device


@pytest.mark.parametrize(
    ("kind", "key", "symbol"),
    [("wave", "impedance_nspm", "b"), ("tdpa", "impedance_nspm", "b"), ("coupling", "damping_nspm", "B")],
)
def test_both_sides_of_what_a_device_carries(kind: str, key: str, symbol: str) -> None:
    record = phantom().capability
    most = largest_impedance(record, T_C).impedance_nspm
    assert refusal(asked(kind=kind, **{key: most}), record) == ""
    text = refusal(asked(kind=kind, **{key: 1.001 * most}), record)
    assert text.startswith(f"anna: {symbol} = ")
    assert text.endswith(f"set coupling.{key} to {rounded_down(most):g} or less")
    would_do = float(text.rpartition(" to ")[2].split()[0])
    assert refusal(asked(kind=kind, **{key: would_do}), record) == ""


def test_the_other_damper_is_not_the_devices() -> None:
    """B of waves is rendered by the server."""
    assert not refusal(asked(kind="wave", damping_nspm=1e3), phantom().capability)
    assert not refusal(asked(kind="coupling", impedance_nspm=1e3), phantom().capability)


@pytest.mark.parametrize(
    ("value", "text"), [(25.6, 25.6), (25.69, 25.6), (0.012345, 0.0123), (0.0, 0.0), (float("nan"), 0.0)]
)
def test_what_would_do_is_never_above(value: float, text: float) -> None:
    assert rounded_down(value) == text


class Grown(SimulatedDevice):
    """A device that carries less than its address lets expect, as it says once it is open."""

    record: Capability

    def open(self, rate_hz: int) -> None:
        super().open(rate_hz)
        self.capability = self.record


def seated(device: SimulatedDevice, settings: SeatSettings) -> ClientCore:
    core = ClientCore(hello(), device.capability)
    core.handle(Connect(), 0)
    core.receive(welcome(settings), 0)
    assert core.seated
    return core


def test_a_device_is_not_even_opened_with_more_than_it_carries() -> None:
    device = phantom()
    core = seated(device, asked(impedance_nspm=50.0))
    with pytest.raises(OverloadError, match=r"set coupling\.impedance_nspm to 20 or less"):
        SupervisedDevice(device, core, 1024, spared=True).open()
    with pytest.raises(Exception, match="closed"):
        device.read(0)
    SupervisedDevice(device, core, 1024).open()  # virtual time, in nobody's hand
    device.close()


def test_a_device_that_turns_out_weaker_is_closed_again() -> None:
    """The record is judged at first, and when the device is opened anew after a fault."""
    whole = phantom()
    weak = replace(whole.capability, damping_nspm=8.0)
    device = Grown(whole.capability, whole.plant, whole.hand)
    device.record = weak
    with pytest.raises(OverloadError, match=r"its record bound.* to 8 or less"):
        SupervisedDevice(device, seated(device, asked()), 1024, spared=True).open()
    with pytest.raises(Exception, match="closed"):
        device.read(0)

    device.capability = device.record = whole.capability
    core = seated(device, asked())
    handle = SupervisedDevice(device, core, 1024, spared=True)
    handle.open()
    device.close()
    handle.read(0)
    assert core.safety.state == "fault"
    device.record = weak
    assert "to 8 or less" in handle.rearm()
    assert core.safety.state == "fault"
