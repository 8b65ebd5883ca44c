"""Scenarios of a HID port and its reports, by hidapi on its stub."""

from cogrip.devices.arm.driver import ArmDevice
from cogrip.devices.arm.models import MODELS
from cogrip.devices.hid.frames import CODECS
from cogrip.devices.io import hid_line

from tests.devices.hid_bench import LONG_S, NOTHING, WAITED, Bench, fails, fails_at_last

MODEL = MODELS["woodenhaptics"]


def scenario_a_request_has_one_reply(bench: Bench) -> None:
    line, codec = bench.open(), CODECS["mbed14"]()
    bench.set(a=400, b=-300, c=6200, d=10030, e=12, f=-5, info=1)
    assert line.read() == b""
    for number in (1, 2, 3):
        line.write(codec.encode((number, -number, 0)))
        report = line.read(LONG_S)
        assert report == bytes.fromhex("9001d4fe38182e270c00fbff0100")
        [reading] = codec.feed(report)
        assert reading.raw == (400, -300, 6200)
        assert bench.currents == (number, -number, 0)
        assert bench["length_written"] == 15
        assert line.read() == b""
    line.close()
    line.close()
    assert (bench["is_open"], bench["closed"]) == (0, 1)
    assert line.counts.keys() <= {WAITED}


def scenario_a_closed_port_says_so(bench: Bench) -> None:
    line = bench.line()
    fails(line.read, "is closed; open it first")
    fails(lambda: line.write(NOTHING), "is closed")
    line.open()
    fails(line.open, "is open already")
    line.close()
    fails(line.read, "is closed")
    line.open()
    line.write(NOTHING)
    assert len(line.read(LONG_S)) == 14


def scenario_waits_are_whole_milliseconds_and_never_for_ever(bench: Bench) -> None:
    line = bench.open()
    for wait_s, wait_ms in ((0.0, -2), (-1.0, -2), (1e-9, -2), (0.00024, -2), (0.000999, -2), (0.001, 1), (0.0029, 2)):
        bench.set(last_wait_ms=-2)
        assert line.read(wait_s) == b""
        assert bench["last_wait_ms"] == wait_ms, wait_s


def scenario_a_short_wait_sees_what_comes_meanwhile(bench: Bench) -> None:
    line = bench.open()
    for _ in range(20):
        line.write(NOTHING)
        while not line.read(0.0009):
            pass
    assert line.counts.keys() <= {WAITED}


def scenario_of_several_reports_the_newest_is_read(bench: Bench) -> None:
    line = bench.open()
    bench.set(extra=4, a=100)
    line.write(NOTHING)
    while bench["left_in_queue"] < 5:
        pass
    report = line.read()
    assert int.from_bytes(report[:2], "little") == 104
    assert line.counts == {"older report passed over": 4}
    assert line.read() == b""


def scenario_the_report_that_waited_is_thrown_away(bench: Bench) -> None:
    bench.set(stale=1, a=5)
    line = bench.open()
    assert line.counts == {"old report thrown away": 1}
    assert line.read() == b""
    line.write(NOTHING)
    assert int.from_bytes(line.read(LONG_S)[:2], "little") == 5


def scenario_reports_of_another_length_are_another_firmware(bench: Bench) -> None:
    bench.set(stale=1, stale_bytes=8)
    line = bench.line()
    fails(line.open, "its reports have 8 bytes, not 14; set the key variant")
    assert bench["is_open"] == 0
    old = bench.open("mbed8")
    old.close()


def scenario_a_longer_report_is_not_cut_to_a_right_one(bench: Bench) -> None:
    line, codec = bench.open(), CODECS["mbed14"]()
    bench.set(report_bytes=20)
    line.write(bytes(21))
    assert codec.feed(line.read(LONG_S)) == []
    assert codec.skipped == 1


def scenario_two_are_told_apart(bench: Bench) -> None:
    bench.set(devices=2)
    fails(bench.open, "2 devices 1234:0006", "/dev/hidraw7 serial=0123456789", "serial=second", "choose by serial=")
    for asked, path in (({"serial": "second"}, "/dev/hidraw7-second"), ({"path": "/dev/hidraw7"}, "/dev/hidraw7")):
        line = bench.open(**asked)
        assert bench.opened == line.path == path
        line.close()
    fails(lambda: bench.open(serial="third"), "has serial=third")
    fails(lambda: bench.open(path="/dev/hidraw8"), "has path=/dev/hidraw8")


def scenario_a_link_is_followed(bench: Bench) -> None:
    node, link = bench.folder / "hidraw3", bench.folder / "arm"
    node.touch()
    link.symlink_to(node)
    bench.say(path=str(node))
    bench.set(devices=2)
    bench.open(path=str(link))
    assert bench.opened == str(node)


def scenario_the_one_interface_of_a_teensy(bench: Bench) -> None:
    for tells_usage in (1, 0):
        bench.set(vendor=0x16C0, product=0x0486, interfaces=2, report_bytes=64, tells_usage=tells_usage, b=-7)
        bench.say(product="Teensyduino RawHID")
        line, codec = bench.open("teensy64"), CODECS["teensy64"]()
        assert bench.opened == "/dev/hidraw7"
        line.write(codec.encode((1, 2, 3)))
        [reading] = codec.feed(line.read(LONG_S))
        assert reading.raw == (0, -7, 0)
        assert bench["length_written"] == 65
        assert bench.currents == (1, 2, 3)
        line.close()


def scenario_it_cannot_be_opened(bench: Bench) -> None:
    bench.set(open_fails=1)
    fails(bench.open, "/dev/hidraw7 cannot be opened", "close the program that uses it", "99-cogrip.rules")


def scenario_a_write_that_fails_or_is_short(bench: Bench) -> None:
    for result in (-1, 7, 14, 16):
        line = bench.open()
        bench.set(write_result=result)
        line.write(NOTHING)
        fails_at_last(line, f"a report of 15 bytes was written, the answer is {result}", "re-arm")
        fails(lambda line=line: line.write(NOTHING), f"the answer is {result}")
        line.close()
        bench.set(write_result=0)
    assert bench["closed"] == 4


def scenario_unplugged(bench: Bench) -> None:
    line = bench.open()
    line.write(NOTHING)
    assert line.read(LONG_S)
    bench.set(unplugged=1)
    fails(line.read, "unplugged", "plug it in again, then re-arm")
    fails(lambda: line.read(LONG_S), "unplugged")
    line.close()
    assert bench["is_open"] == 0


def scenario_a_device_that_hangs_does_not_hold_up_the_loop(bench: Bench) -> None:
    """Were these writes to wait for the device, nobody would come to let it go on."""
    line, codec = bench.open(), CODECS["mbed14"]()
    bench.set(hangs=1)
    line.write(codec.encode((1, 1, 1)))
    while not bench["reports_written"]:
        pass
    for current in (2, 3, 0):
        line.write(codec.encode((current, 0, 0)))
        assert line.read() == b""
    assert line.counts == {WAITED: 3}
    assert bench["reports_written"] == 1
    bench.set(hangs=0)
    while bench["reports_written"] < 2 or bench["left_in_queue"] < 2:
        pass
    assert len(line.read(LONG_S)) == 14
    line.close()
    assert bench["reports_written"] == 2  # the newest alone: what was asked for in between is over
    assert bench.currents == (0, 0, 0)
    assert line.counts["report replaced by a newer one"] == 2


def scenario_a_port_that_hangs_can_be_closed(bench: Bench) -> None:
    line = bench.open()
    bench.set(hangs=1)
    line.write(NOTHING)
    while not bench["reports_written"]:
        pass
    patience_s, hid_line.CLOSE_S = hid_line.CLOSE_S, 0.01
    line.close()
    hid_line.CLOSE_S = patience_s
    assert line.counts == {"closed while a report was on its way": 1}
    assert bench["is_open"] == 1  # closing it now would pull it from under the write
    bench.set(hangs=0)
    while bench["is_open"]:
        pass


def scenario_the_last_report_goes_before_it_is_closed(bench: Bench) -> None:
    for number in range(1, 11):
        line = bench.open()
        line.write(CODECS["mbed14"]().encode((number, 0, 0)))
        line.close()
        assert bench.currents == (number, 0, 0)
        assert not bench["is_open"]


def centre() -> tuple[int, int, int]:
    angles = MODEL.kinematics.inverse((0.0, 0.0, 0.0))
    a, b, c = (round(count - home) for count, home in zip(MODEL.drive.counts(angles), MODEL.home_counts, strict=True))
    return a, b, c


def step(bench: Bench, device: ArmDevice, tick: int, force=(0.0, 0.0, 0.0)):
    """A tick, and then time for the wire."""
    sample = device.read(tick)
    device.write(force)
    while not bench["left_in_queue"]:
        pass
    return sample


def scenario_an_arm_is_opened_read_pushed_and_let_go(bench: Bench) -> None:
    bench.set(stale=1)
    bench.stand_at(centre())
    device = bench.device()
    device.open(1000)
    assert bench.currents == (0, 0, 0)
    samples = [step(bench, device, tick, (1.0, 0.0, 0.0)) for tick in range(5)]
    assert samples[0] is None
    position = samples[-1].position_m
    assert max(map(abs, position)) < MODEL.record.resolution_m, position
    assert samples[-1].age_ticks == 1
    expected, _ = MODEL.currents(device.angles, (-1.0, 0.0, 0.0))
    assert bench.currents == expected
    assert expected != (0, 0, 0)
    fails(lambda: (device.read(5), device.write((float("nan"), 0.0, 0.0))), "not finite")
    while not bench["left_in_queue"]:
        pass
    assert bench.currents == (0, 0, 0)
    step(bench, device, 6, (1.0, 0.0, 0.0))
    assert bench.currents == expected
    device.close()
    assert bench.currents == (0, 0, 0)
    assert not bench["is_open"]
