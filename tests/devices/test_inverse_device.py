"""The driver of `inverse:` on an emulated service, in virtual time: its messages, and whatever may be wrong with them."""

import json
from math import dist, hypot, inf, nan

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cogrip.devices import DeviceError, Sample
from cogrip.devices.emulated.emulated_device import EmulatedDevice
from cogrip.devices.emulated.inverse_service import InverseService
from cogrip.devices.family.machines import make_firmware
from cogrip.devices.inverse.messages import InverseCodec
from cogrip.devices.inverse.models import CENTRE_M

from tests.devices import held_device
from tests.devices.held_device import RATE_HZ

PUSH = (0.3, -0.2, 0.1)
FADED = round(0.05 * RATE_HZ)  # ticks within which no force may be left


def inventory(**arm: object) -> bytes:
    """Return the first message of a service of format 3.5, with this in its Inverse3 changed."""
    service = make_firmware("inverse3", {})
    service.connect()
    (message,) = service.due(0)
    told = json.loads(message)
    told["inverse3"][0] |= arm
    return json.dumps(told).encode()


def chosen(message: bytes = b"", device: str = "", grip: str = "") -> InverseCodec:
    codec = InverseCodec(device, grip, "auto")
    codec.choose(message or inventory(), "inverse:", uncalibrated=False)
    return codec


def update(codec: InverseCodec, **state: object) -> bytes:
    place = {"x": 0.0, "y": 0.0, "z": 0.0}
    told = {"device_id": codec.device_id, "state": {"cursor_position": place, **state}}
    return json.dumps({"inverse3": [told]}).encode()


def opened(query: str = "hand=hold") -> tuple[EmulatedDevice, InverseService]:
    device = held_device.opened(f"emulated:inverse3?{query}", axes=3)
    return device, device.firmware


def hold(device: EmulatedDevice, ticks: range) -> list[Sample]:
    return [sample for sample in held_device.hold(device, ticks, PUSH) if sample is not None]


def test_axes_are_a_quarter_turn_of_the_service_s() -> None:
    """Right, forward, up is their x, y, z; toward the user, right, up ours: a rotation, so a force's work is the same."""
    codec = chosen()
    command = {"set_cursor_force": {"vector": {"x": 2.0, "y": -1.0, "z": 3.0}}}
    assert json.loads(codec.encode((1.0, 2.0, 3.0)))["inverse3"] == [{"device_id": "049D", "commands": command}]
    (reading,) = codec.feed(update(codec, cursor_position={"x": 0.1, "y": 0.2, "z": 0.3}))
    assert reading.raw[:3] == (-0.2, 0.1, 0.3)


def test_an_older_service_gets_its_own_name_of_the_force() -> None:
    """Format 3.1 says `values`, and shows no session in its inventory; both service and driver are told apart by it."""
    old = make_firmware("inverse3", {})
    assert isinstance(old, InverseService)
    old.old = True
    old.connect()
    codec = chosen(old.due(0)[0])
    force = json.loads(codec.encode((1.0, 0.0, 0.0)))["inverse3"][0]["commands"]["set_cursor_force"]
    assert force == {"values": {"x": 0.0, "y": -1.0, "z": 0.0}}
    old.receive(codec.encode((1.0, 0.0, 0.0)), 1)
    assert old.refused == 0
    assert old.mechanics.force_n == (1.0, 0.0, 0.0)


def test_samples_are_where_the_hand_is_and_the_hand_gets_the_force_the_other_way() -> None:
    device, service = opened("hand=reach&amplitude_m=0.02")
    samples = hold(device, range(600))
    assert [sample.age_ticks for sample in samples] == [1] * 599  # one a tick, from the second on
    assert dist(samples[-1].position_m, service.mechanics.body.position_m) < 2e-4
    assert service.mechanics.force_n == pytest.approx([-part for part in PUSH], abs=1e-3)
    assert device.counts == {}


def test_buttons_and_orientation_are_the_grip_s() -> None:
    device, service = opened()
    (first, *_) = hold(device, range(3))
    assert first.buttons == 0
    service.press()
    samples = hold(device, range(3, 515))
    assert {sample.buttons for sample in samples[2:]} == {1}
    turned = samples[-1].orientation
    assert turned is not None
    assert hypot(*turned) == pytest.approx(1.0)
    assert turned[1] < -0.1  # about their y, which is our -x
    assert turned[2] == turned[3] == 0.0
    assert device.capability.buttons == 3
    assert device.capability.gives_orientation


STATE = b'{"inverse3": [{"device_id": "049D", "state": {"cursor_position": {"x": %s, "y": 0, "z": 0}}}]}'


@pytest.mark.parametrize(
    ("wrong", "counted"),
    [
        (b"", {}),
        (b"\xff\x00", {"message malformed": 1}),
        (b'{"inverse3": {"049D": {}}}', {"message malformed": 1}),  # format 3.0
        (b'{"inverse3": [{"device_id": "049D"}]}', {"message malformed": 1}),
        (STATE % b"NaN", {"message malformed": 1}),
        (STATE % b"1e999", None),
        (STATE % b"2.01", {"message out of range": 1}),
    ],
)
def test_a_message_that_is_none_is_counted(wrong: bytes, counted: dict[str, int] | None) -> None:
    codec = chosen()
    assert codec.feed(wrong) == []
    assert codec.refused == (codec.refused if counted is None else counted)
    assert codec.refused.total() == bool(wrong)


@given(st.binary(max_size=300))
def test_no_bytes_make_the_codec_raise(data: bytes) -> None:
    assert CODEC.feed(data) == []


CODEC = chosen()


def test_a_place_is_within_two_metres_and_an_orientation_has_norm_one() -> None:
    codec = chosen()
    for x_m, good in ((2.0, True), (2.0001, False), (-2.0, True), (-2.0001, False)):
        assert bool(codec.feed(update(codec, cursor_position={"x": x_m, "y": 0, "z": 0}))) == good
    told = json.loads(update(codec))
    for w, known in ((1.0, True), (1.009, True), (0.98, False), (0.0, False)):
        turned = {"orientation": {"w": w, "x": 0, "y": 0, "z": 0}}
        told["wireless_verse_grip"] = [{"device_id": codec.grip_id, "state": turned}]
        (reading,) = codec.feed(json.dumps(told).encode())
        assert reading.raw[4:8] == ((1.0, 0.0, 0.0, 0.0) if known else (0.0,) * 4)


WHOLE = {"power_supply": True, "ready": True, "calibrated": True}


@pytest.mark.parametrize(
    ("arm", "words"),
    [
        ({"status": WHOLE | {"power_supply": False}}, "049D has no power; plug in its supply"),
        ({"status": WHOLE | {"ready": False}}, "is not ready"),
        ({"status": WHOLE | {"calibrated": False}}, "is not calibrated; .*uncalibrated=allow"),
        ({"config": {"basis": {"permutation": "XZY"}}}, "has axes XZY; set its basis to XYZ"),
        ({"config": {"mount": {"scale": {"x": 1.0, "y": 2.0, "z": 1.0}}}}, "positions that are scaled"),
        ({"device_id": 5}, "no inventory of the formats 3.1 to 3.5"),
    ],
)
def test_no_force_flows_where_the_inventory_says_that_it_must_not(arm: dict[str, object], words: str) -> None:
    with pytest.raises(DeviceError, match=words):
        chosen(inventory(**arm))


def test_a_device_and_a_grip_are_chosen_by_name() -> None:
    told = json.loads(inventory())
    told["inverse3"].append(told["inverse3"][0] | {"device_id": "04BA"})
    two = json.dumps(told).encode()
    with pytest.raises(DeviceError, match=r"several Inverse3, of 049D, 04BA; .*choose by device=ID"):
        chosen(two)
    assert chosen(two, device="04BA").device_id == "04BA"
    with pytest.raises(DeviceError, match="no Inverse3 'x', of 049D, 04BA"):
        chosen(two, device="x")
    with pytest.raises(DeviceError, match="no VerseGrip 'x', of 61548"):
        chosen(grip="x")
    assert chosen(json.dumps({"inverse3": told["inverse3"][:1]}).encode()).grip_id == ""
    with pytest.raises(DeviceError, match="no Inverse3, of none; plug one in"):
        chosen(b"{}")


@pytest.mark.parametrize("verb", ["silence", "garbage", "short", "slow"])
def test_a_service_that_does_not_answer_well_has_no_force_left_in_50_ms(verb: str) -> None:
    device, service = opened()
    hold(device, range(100))
    service.fault(verb)
    hold(device, range(100, 100 + FADED))
    assert service.mechanics.force_n == (0.0, 0.0, 0.0)
    assert device.write(PUSH) == (0.0, 0.0, 0.0)
    service.mend()
    assert hold(device, range(100 + FADED, 400))
    assert hypot(*service.mechanics.force_n) == pytest.approx(hypot(*PUSH), abs=2e-3)


def test_a_stale_answer_is_not_taken_for_the_next_one() -> None:
    device, service = opened("hand=reach&amplitude_m=0.03")
    hold(device, range(100))
    service.fault("stale")
    hold(device, range(100, 160))
    (last,) = hold(device, range(160, 161))
    assert dist(last.position_m, service.mechanics.body.position_m) < 1e-3
    assert last.age_ticks == 1


@pytest.mark.parametrize(("verb", "words"), [("unplug", "it was unplugged"), ("model", "the service has it no more")])
def test_a_service_that_is_killed_and_a_device_that_is_gone_are_lost_until_opened_again(verb: str, words: str) -> None:
    device, service = opened()
    hold(device, range(100))
    assert hypot(*service.mechanics.force_n) > 0.3
    service.fault(verb)
    with pytest.raises(DeviceError, match=f"lost: {words}.*then re-arm"):
        hold(device, range(100, 100 + FADED))
    with pytest.raises(DeviceError, match=words):
        device.write((0.0, 0.0, 0.0))
    assert service.mechanics.force_n == (0.0, 0.0, 0.0)
    device.close()
    service.mend()
    device.open(RATE_HZ)
    assert hold(device, range(100))
    assert hypot(*service.mechanics.force_n) > 0.3
    device.close()
    assert service.mechanics.force_n == (0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("status", "words"),
    [("power_supply", "no power"), ("ready", "not ready"), ("calibrated", "not calibrated any more")],
)
def test_a_device_that_says_in_a_session_that_it_is_not_well_is_lost_and_no_force_is_booked(
    status: str, words: str
) -> None:
    device, service = opened()
    hold(device, range(100))
    service.status[status] = False
    assert device.read(100) is not None, "an update of before"
    device.write(PUSH)
    assert device.read(101) is None
    assert device.write(PUSH) == (0.0, 0.0, 0.0)
    with pytest.raises(DeviceError, match=f"lost: {words}"):
        hold(device, range(102, 120))
    assert service.mechanics.force_n == (0.0, 0.0, 0.0)


@pytest.mark.parametrize(("pause", "idle"), [(20, False), (26, True), (90, True)])
def test_force_after_a_pause_in_which_it_may_have_gone_idle_is_held_back(pause: int, idle: bool) -> None:
    """So that the client, which is told that nothing acts, takes it back by its ramp."""
    device, service = opened()
    hold(device, range(100))
    told, acted = [], []
    for tick in range(99 + pause, 140 + pause):
        device.read(tick)
        told.append(device.write(PUSH))
        acted.append(any(service.mechanics.force_n))
    assert told.count((0.0, 0.0, 0.0)) == (20 if idle else 0)
    assert acted.count(False) == (20 if idle else 0)
    assert not told[-1]


def test_a_position_that_freezes_while_the_device_s_own_velocity_goes_on_is_lost() -> None:
    """The same motion is believed as long as its position goes on."""
    device, _ = opened("hand=reach&amplitude_m=0.04&stroke_s=0.3&delay_s=0.05")
    assert len(hold(device, range(400))) > 390
    device, service = opened("hand=reach&amplitude_m=0.04&stroke_s=0.3&delay_s=0.05")
    hold(device, range(180))
    for joint in range(3):
        service.mechanics._frozen[joint] = service.mechanics.counters[joint]
    with pytest.raises(DeviceError, match="lost: its position stands still, and its own velocity"):
        hold(device, range(180, 260))


@pytest.mark.parametrize("wrong", [(nan, 0.0, 0.0), (inf, 0.0, 0.0), (0.1, 0.1)])
def test_a_force_that_is_none_becomes_zero(wrong: tuple[float, ...]) -> None:
    device, service = opened()
    hold(device, range(50))
    device.read(50)
    with pytest.raises(DeviceError, match="the force is zero now"):
        device.write(wrong)
    device.read(51)
    assert service.mechanics.force_n == (0.0, 0.0, 0.0)


def test_the_centre_is_where_the_address_puts_it() -> None:
    device, _ = opened(f"hand=hold&centre_m={CENTRE_M[0] + 0.01},0,0.16")
    assert hold(device, range(3))[-1].position_m == pytest.approx((-0.01, 0.0, 0.0), abs=1e-4)
