"""The family `sim:`: a table of machines and a table of hands, and how query keys are shared out between them."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cache
from importlib import import_module
from importlib.metadata import entry_points
from math import inf
from typing import Any, Literal

import msgspec

from cogrip.devices.device import Capability, Device, DeviceError
from cogrip.devices.registry import Family
from cogrip.devices.settings import MOST_AXES, Address, Setting, check_axes, keys_of, read_settings, unknown
from cogrip.devices.simulated import grasp, gripper, hands, ideal, phantom, pose, waypoints
from cogrip.devices.simulated.presses import read_presses
from cogrip.devices.simulated.recorded_settings import RecordedSettings
from cogrip.devices.simulated.simulated_device import Plant, SimulatedDevice
from cogrip.protocol.axes import GRIP_AXES, PLACES, POSE_AXES


@dataclass(frozen=True, slots=True)
class SimulatedMachine:
    """A simulated machine: its query keys, its record, its plant; of more than MOST_AXES axes it turns, or has a gripper."""

    settings: type[msgspec.Struct]
    capability: Callable[[Any, int], Capability]
    plant: Callable[[Any, int], Plant]
    axes: int = MOST_AXES
    held_by: Callable[[hands.Hand, Any], hands.Hand] | None = None  # what a hand of places becomes on all these axes


@dataclass(frozen=True, slots=True)
class HandKind:
    """A kind of hand: its query keys and its maker, called (settings, axes), and the argument where it `takes` one.

    turns: it can turn, where the machine does; `only`: it needs that
    """

    settings: type[msgspec.Struct]
    make: Callable[..., hands.Hand]
    takes: str = ""
    turns: Literal["", "can", "only"] = ""


MACHINES: dict[str, SimulatedMachine] = {
    "ideal": SimulatedMachine(ideal.IdealSettings, ideal.capability, ideal.IdealPlant),
    "phantom": SimulatedMachine(phantom.PhantomSettings, phantom.capability, phantom.PhantomPlant),
    "freeflyer": SimulatedMachine(pose.FreeflyerSettings, pose.freeflyer, pose.freeflyer_plant, POSE_AXES),
    "phantom6": SimulatedMachine(pose.Phantom6Settings, pose.phantom6, pose.phantom6_plant, POSE_AXES),
    "gripper": SimulatedMachine(
        gripper.GripperSettings, gripper.record, gripper.plant, GRIP_AXES, gripper.SqueezingHand
    ),
}


def _make_recorded(settings: RecordedSettings, axes: int, path: str) -> hands.Hand:
    from cogrip.devices.simulated.recorded_hand import RecordedHand  # with numpy, as below

    return RecordedHand(settings, axes, path)


def _make_reconstructed(settings: hands.ImpedanceSettings, axes: int, run: str) -> hands.Hand:
    from cogrip.devices.simulated.reconstructed_hand import ReconstructedHand

    return ReconstructedHand(settings, axes, run)


HANDS: dict[str, HandKind] = {
    "hold": HandKind(hands.ImpedanceSettings, hands.make_hold),
    "push": HandKind(hands.PushSettings, hands.PushHand),
    "reach": HandKind(hands.ReachSettings, hands.directed(hands.reach_course)),
    "approach": HandKind(hands.ApproachSettings, hands.directed(hands.approach_course)),
    "sine": HandKind(hands.SineSettings, hands.directed(hands.sine_course)),
    "tremor": HandKind(hands.TremorSettings, hands.directed(hands.tremor_course)),
    "waypoints": HandKind(waypoints.WaypointSettings, waypoints.WaypointHand, turns="can"),
    "grasp": HandKind(grasp.GraspSettings, grasp.make_grasp, turns="can"),
    "csv": HandKind(RecordedSettings, _make_recorded, takes="FILE"),
    "recording": HandKind(hands.ImpedanceSettings, _make_reconstructed, takes="RUN"),
    "crank": HandKind(pose.CrankSettings, pose.CrankHand, turns="only"),
}

GROUP = "cogrip.hands"
_REGISTERED: dict[str, HandKind] = {}


def register_hand(
    name: str, make: Callable[..., hands.Hand], settings: type[msgspec.Struct] = hands.ImpedanceSettings
) -> None:
    """Let `hand=NAME` be a hand of this program's own, in this process.

    make: called with (settings, axes); settings: its query keys, a keyword-only frozen struct. Another package names its hands
    in the entry point group GROUP, each a function that returns a `HandKind`. Raises DeviceError for a name that is taken.
    """
    if name in HANDS or not name.isidentifier():
        raise DeviceError(f"hand {name!r}: is one of cogrip's own, or no plain name; take another")
    _REGISTERED[name] = HandKind(settings, make)


@cache
def _installed() -> dict[str, str]:
    """Return name -> "module:function" of the hands that other packages bring."""
    return {point.name: point.value for point in entry_points(group=GROUP)}


def _kind_called(name: str, where: str) -> HandKind:
    """Return a kind of hand: ours, one registered here, or one of another package. Raises DeviceError."""
    kind = HANDS.get(name) or _REGISTERED.get(name)
    if kind is not None:
        return kind
    target = _installed().get(name)
    if target is None:
        raise unknown("hand", name, {**HANDS, **_REGISTERED, **dict.fromkeys(_installed())}, where)
    module, _, function = target.partition(":")
    try:
        kind = getattr(import_module(module), function)()
    except Exception as error:
        raise DeviceError(
            f"{where}: hand={name}: {target} fails as it is loaded: {error!r}; mend or remove its package"
        ) from error
    if not isinstance(kind, HandKind):
        raise DeviceError(
            f"{where}: hand={name}: {target} gives {type(kind).__name__}, not a HandKind; mend or remove its package"
        )
    return kind


def family() -> Family:
    """The family `sim:`, for the registry."""
    return Family("simulated machines in simulated hands", make, tuple(f"sim:{name}" for name in MACHINES), _axes)


def _axes(address: Address) -> int:
    machine = MACHINES.get(address.name)
    return machine.axes if machine else MOST_AXES


def make(address: Address, axes: int, defaults: Mapping[str, Setting]) -> Device:
    """A simulated device; key `hand` is one of HANDS (default hold), `csv:FILE` for a recorded one; `press` presses buttons.

    Raises DeviceError for an unknown machine, hand or key, a value out of bounds, or a number of axes that
    is not 1 to 3, or 6 where it turns.
    """
    where = repr(address.text)
    machine = MACHINES.get(address.name)
    if machine is None:
        raise unknown("simulated device", address.name, MACHINES, where)
    if axes != machine.axes:
        check_axes(axes, where)
    query: dict[str, Setting] = {**defaults, **address.query}
    kind, argument = _hand_kind(str(query.pop("hand", "hold")), where)
    presses = read_presses(str(query.pop("press", "")), where)
    machine_keys, hand_keys = keys_of(machine.settings), keys_of(kind.settings)
    for key in query:
        if key not in machine_keys and key not in hand_keys:
            raise unknown("key", key, ("hand", "press", *machine_keys, *hand_keys), where)
    machine_settings: Any = read_settings(machine.settings, {k: query[k] for k in query if k in machine_keys}, where)
    hand_settings = read_settings(kind.settings, {k: query[k] for k in query if k in hand_keys}, where)
    if kind.turns == "only" and axes != POSE_AXES:
        raise DeviceError(
            f"{where}: this hand turns, and the device has {axes} axes; take sim:freeflyer or sim:phantom6 of 6"
        )
    if axes == POSE_AXES and not kind.turns:
        hand: hands.Hand = pose.UnturnedHand(kind.make(hand_settings, PLACES, *argument))
    elif axes == machine.axes and machine.held_by:
        hand = machine.held_by(kind.make(hand_settings, PLACES, *argument), machine_settings)
    else:
        hand = kind.make(hand_settings, axes, *argument)
    plant = machine.plant(machine_settings, axes)
    record = machine.capability(machine_settings, axes)
    record = replace(record, buttons=max((press.button for press in presses), default=0))
    return SimulatedDevice(record, plant, hand, machine_settings.x0_m, presses, getattr(hand_settings, "let_go_s", inf))


def _hand_kind(text: str, where: str) -> tuple[HandKind, tuple[str, ...]]:
    name, colon, argument = text.partition(":")
    kind = _kind_called(name, where)
    if bool(argument) != bool(kind.takes) or (colon and not argument):
        cure = f"write hand={name}:{kind.takes}" if kind.takes else f"{name} takes no argument: write hand={name}"
        raise DeviceError(f"{where}: hand={text!r}: {cure}")
    return kind, (argument,) if argument else ()
