"""A client with a device in its hand that moves evenly, and jumps."""

from collections.abc import Callable
from itertools import pairwise

from cogrip.client.inputs import DeviceOpened
from cogrip.client.supervised_device import SupervisedDevice
from cogrip.devices.device import Device
from cogrip.protocol.rates import due_ns

from tests.client.seated_client import DEVICE_HZ, Client, M

SPEED_MPS = 0.05  # 1 N on a damper of 20 N s/m
JUMP_TICK, TICKS = 500, 700


def forces_over_a_jump(device: Device, move: Callable[[float], None], jump_m: float) -> tuple[Client, list[float]]:
    """The forces that a client of one axis asks the device for, tick by tick. move: to a place along x [m]."""
    client, forces = Client(), []
    handle = SupervisedDevice(device, client.core, DEVICE_HZ)
    move(-0.02)
    handle.open()
    client.core.handle(DeviceOpened(device.capability), client.core.now_ns)
    for tick in range(TICKS):
        now_ns = due_ns(0, tick, DEVICE_HZ)
        move(-0.02 + SPEED_MPS * tick / DEVICE_HZ + (jump_m if tick >= JUMP_TICK else 0.0))
        if tick % M == 0 and tick:
            client.hear(now_ns)
        client.core.sense(tick, handle.read(tick), now_ns)
        handle.write(client.core.act(now_ns))
        forces.append(client.core.force_n[0])
    handle.close()
    return client, forces


def ends_softly(client: Client, forces: list[float]) -> None:
    """A fault with the jump's name; no step above 0.5 N; none left within 50 ms."""
    assert forces[JUMP_TICK - 1] > 0.8
    assert client.core.safety.state == "fault"
    assert client.core.safety.reason.startswith(("the position jumped: 29.", "the position jumped: 30."))
    steps = [abs(new - old) for old, new in pairwise(forces)]
    assert max(steps) < 0.5
    assert not any(forces[JUMP_TICK + round(0.05 * DEVICE_HZ) :])
