"""Addresses: what is understood, and what is said about what is not."""

import subprocess
import sys
from contextlib import suppress

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cogrip.devices import DeviceError, describe, families, make
from cogrip.devices.family.simulated import HANDS
from cogrip.devices.registry import FAMILIES, axes_of
from cogrip.devices.settings import parse_address

from tests.devices.held_device import opened, refused


def test_address_falls_into_its_parts() -> None:
    text = "sim:phantom?hand=csv:/a b/c?d=e:#%41.csv&time=t_s&where=run:spring"
    parsed = parse_address(text)
    assert (parsed.text, parsed.scheme, parsed.name) == (text, "sim", "phantom")
    assert parsed.query == {"hand": "csv:/a b/c?d=e:#%41.csv", "time": "t_s", "where": "run:spring"}
    assert parse_address("serial:/dev/ttyACM0").name == "/dev/ttyACM0"


@given(st.text(alphabet=st.characters(exclude_characters="&"), min_size=1))
def test_a_value_may_hold_anything_but_an_ampersand(value: str) -> None:
    assert parse_address(f"sim:ideal?hand=csv:{value}&x=a").query == {"hand": f"csv:{value}", "x": "a"}


@given(st.text())
def test_any_text_is_a_device_or_a_device_error(text: str) -> None:
    for address in (text, f"sim:{text}", f"sim:ideal?{text}", f"sim:ideal?hand={text}"):
        with suppress(DeviceError):
            make(address)


@pytest.mark.parametrize(
    ("address", "said"),
    [
        ("phantom", ["no scheme"]),
        ("", ["no scheme"]),
        ("sym:ideal", ["'sym'", "did you mean 'sim'"]),
        ("sim:fantom", ["'fantom'", "did you mean 'phantom'", "ideal, phantom"]),
        ("sim:", ["ideal, phantom"]),
        ("sim:ideal?hand=rech", ["'rech'", "did you mean 'reach'", ", ".join(HANDS)]),
        ("sim:ideal?hand=hold:3", ["hold takes no argument"]),
        ("sim:ideal?hand=csv", ["hand=csv:FILE"]),
        ("sim:ideal?hand=csv:f.csv&x=a", ["'time'"]),
        ("sim:ideal?mas_kg=1", ["'mas_kg'", "did you mean 'mass_kg'", "damping_nspm"]),
        ("sim:ideal?hand=push&hand_stiffness_npm=3", ["hand_stiffness_npm", "force_n"]),
        ("sim:ideal?friction_n=1", ["friction_n"]),
        ("sim:ideal?mass_kg=0", ["mass_kg: expects a number of at least", "in kg; got '0'"]),
        ("sim:ideal?mass_kg=nan", ["mass_kg: expects", "got 'nan'"]),
        ("sim:ideal?mass_kg=light", ["mass_kg: expects a number, in kg; got 'light'"]),
        ("sim:ideal?mass_kg", ["'mass_kg' is not key=value"]),
        ("sim:ideal?mass_kg=1&mass_kg=2", ["given twice"]),
        ("sim:ideal?hand=csv:f&time=t&x=x&origin=stat", ["origin: expects one of", "start, keep", "got 'stat'"]),
        ("sim:ideal?x0_m=0,0", ["x0_m", "2 numbers", "1 axes"]),
        ("sim:ideal?hand=reach&direction=1,1", ["direction", "1 axes"]),
        ("sim:ideal?hand=csv:f&time=t&x=x&y=y", ["y='y'", "needs 2 axes"]),
    ],
)
def test_error_names_the_thing_and_the_cure(address: str, said: list[str]) -> None:
    with refused(*said):
        make(address)


WRONG = [
    ("forcedimension:", 3, "'' is no number from 0 to 15: write forcedimension:0"),
    ("forcedimension:16", 3, "'16' is no number from 0 to 15"),
    ("forcedimension:-1", 3, "'-1' is no number"),
    ("forcedimension:²", 3, "is no number"),
    ("forcedimension:0?model=touch", 3, "model: expects one of falcon, omega3"),
    ("forcedimension:0?peak_force_n=-1", 3, "peak_force_n: expects a number"),
    ("openhaptics:x?model=falcon", 3, "model: expects one of touch, omni"),
    ("openhaptics:x?peak_force_n=0", 3, "peak_force_n: expects a number"),
    ("openhaptics:x?peak_force_n=41", 3, "peak_force_n: expects a number"),
    ("hid:woodnhaptics", 3, "did you mean 'woodenhaptics'"),
    ("hid:vintage", 3, "unknown HID arm 'vintage'", "woodenhaptics"),
    ("hid:", 3, "unknown HID arm"),
    ("hid:woodenhaptics?variant=mbed15", 3, "variant: expects one of mbed14, teensy64, mbed8; got 'mbed15'"),
    ("hid:woodenhaptics?backend=usb", 3, "backend: expects one of auto, hidraw, libusb; got 'usb'"),
    ("hid:woodenhaptics?limit_ma=9000,1,1", 3, "limit_ma"),
    ("hid:woodenhaptics?pose=sure", 3, "pose: expects one of stored, home, none; got 'sure'"),
    ("spacemouse:idle?speed_mps=0.181", 3, "speed_mps"),
    ("gamepad:idle?dead=1", 3, "dead"),
    ("gamepad:idle?rumble=1.1", 3, "rumble"),
    ("sim:gripper?open_m=0.04", 4, "open_m=0.04 is out of 0 to 0.03 m"),
    ("sim:gripper?grip_mass_kg=0", 4, "grip_mass_kg"),
    ("sim:phantom6", 4, "axes=4 is out of 1 to 3"),
    ("sim:phantom6?hand=crank", 3, "this hand turns, and the device has 3 axes; take sim:freeflyer or sim:phantom6"),
    ("sim:ideal?hand=waypoints&times_s=1&rx_rad=1", 3, "rx_rad is given, but the device has 3 axes"),
    ("sim:freeflyer?inertia_kgm2=0", 6, "inertia_kgm2"),
    ("sim:freeflyer?hand=crank&axis=w", 6, "axis"),
    ("inverse:localhost:99999", 3, "port '99999' is not a number from 1 to 65535"),
    ("inverse:?centre_m=0,0,2", 3, "centre_m"),
    ("inverse:?command=force", 3, "command"),
    ("inverse:?peak_force_n=0", 3, "peak_force_n"),
    ("haply:", 2, "name the port"),
    ("haply:/dev/x", 2, "add model="),
    ("haply:/dev/x?model=inverse3", 2, "2diy"),
    ("serial:x?model=omega", 3, "got 'omega'"),
    ("serial:", 1, "name the port, such as serial:/dev/ttyACM0"),
]


@pytest.mark.parametrize("wrong", WRONG, ids=lambda wrong: f"{wrong[0]} {wrong[1]}")
def test_every_family_says_what_is_wrong_with_an_address(wrong: tuple[str, int, *tuple[str, ...]]) -> None:
    address, axes, *said = wrong
    with refused(*said):
        make(address, axes=axes)


@pytest.mark.parametrize("address", [listing.address for listing in describe(axes=3)])
def test_every_family_refuses_unknown_keys_and_axes(address: str) -> None:
    most = axes_of(address)
    with refused("unknown key 'zzz'"):
        make(f"{address}{'&' if '?' in address else '?'}zzz=1", axes=most)
    for axes in (0, most + 1):
        with refused(f"axes={axes} is out of 1 to "):
            make(address, axes=axes)


def test_unknown_default_is_an_error_too() -> None:
    with pytest.raises(DeviceError, match="mass_kg"):
        make("sim:ideal", mas_kg=0.2)
    with pytest.raises(DeviceError, match="axes=4"):
        make("sim:ideal", axes=4)


def test_address_wins_over_defaults() -> None:
    assert make("sim:ideal?mass_kg=0.3", mass_kg=0.2).capability.apparent_mass_kg == 0.3
    assert make("sim:ideal", mass_kg=0.2).capability.apparent_mass_kg == 0.2
    device = opened("sim:ideal", axes=2, hand="reach", direction=(1.0, 0.5), x0_m=(0.1, 0.2))
    assert device.read(0).position_m == (0.1, 0.2)


def test_start_outside_the_workspace_is_refused() -> None:
    with pytest.raises(DeviceError, match="outside its workspace"):
        make("sim:phantom?x0_m=0.2").open(1024)


def test_listing_names_every_device_unopened() -> None:
    listings = describe(axes=3)
    listed = {listing.address for listing in listings}
    assert listed >= {"sim:ideal", "sim:phantom", "emulated:vintage", "serial:/dev/ttyACM0?model=vintage"}
    assert {address.partition(":")[0] for address in listed} == set(FAMILIES) - {"replay"}
    assert all(listing.capability.axes == min(3, axes_of(listing.address)) for listing in listings)
    assert list(families()) == sorted(FAMILIES)


def test_families_are_imported_when_asked_for() -> None:
    code = "import sys, cogrip.devices; assert not any('simulated' in m or 'scipy' in m for m in sys.modules)"
    subprocess.run([sys.executable, "-c", code], check=True)
