"""The trial of motors before a client of `cogrip.api` takes a seat: that of `cogrip join`, with an option of its own."""

from pathlib import Path

import pytest

import cogrip.api as cogrip
from cogrip.cli.devices import tried_response
from cogrip.devices.registry import make
from cogrip.protocol.recording.reader import open_recording

from tests.devices.faulty_device import SIGN, SWAP, FaultyDevice
from tests.free_ports import free_port

ARM = "emulated:vintage?hand=hold&pose=home"


class TickByTick:
    """Clock of virtual time."""

    def __init__(self, rate_hz: int) -> None:
        """Need nothing."""

    def newest(self, tick: int) -> int:
        return tick


@pytest.fixture(autouse=True)
def virtual(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tried_response, "Clock", TickByTick)


def client(device: cogrip.Device, said: list[str], **options: bool) -> cogrip.Client:
    """Return a client of a server that nobody runs."""
    return cogrip.Client(f"127.0.0.1:{free_port()}", device, say=said.append, **options)


@pytest.mark.parametrize(
    ("fault", "words"), [(SIGN, "x: it moves against its force"), (SWAP, "these axes are swapped")]
)
def test_a_device_that_does_other_than_its_record_says_is_refused_before_a_server_is_asked(
    fault: str, words: str
) -> None:
    device = FaultyDevice(make(ARM, axes=3), fault)
    with pytest.raises(cogrip.ApiError, match=rf"refused: .*{words}.*; trial=False holds it as it is"):
        client(device, []).run()


@pytest.mark.parametrize(
    ("fault", "options", "words"),
    [("", {}, "signs, axes and gains"), (SIGN, {"trial": False}, "motors not tried: trial=False")],
)
def test_one_that_is_well_or_whose_trial_is_left_out_goes_on(fault: str, options: dict[str, bool], words: str) -> None:
    said: list[str] = []
    with pytest.raises(cogrip.ApiError) as refused:
        client(FaultyDevice(make(ARM, axes=3), fault), said, **options).run()
    assert "refused: " not in str(refused.value)
    assert words in said[0]


@pytest.mark.parametrize("device", [cogrip.device_of(lambda time_s, force_n: (0.0,)), make("sim:phantom", axes=3)])
def test_what_has_no_motors_is_not_tried(device: cogrip.Device) -> None:
    said: list[str] = []
    with pytest.raises(cogrip.ApiError):
        client(device, said).run()
    assert not [text for text in said if "motors" in text]


def test_the_outcome_stands_in_the_recording_of_a_seat(tmp_path: Path) -> None:
    """A whole session over real sockets: what the trial found is in the header of the client's recording."""
    settings = {"name": "tried", "seconds": 0.5, "object": {"axes": 3}, "users": [{"name": "ben"}]}
    with cogrip.Session(settings, mine=["ben"], folder=tmp_path) as session:
        session.client("ben", make(ARM, axes=3))
        run = session.wait()
    assert open_recording(run.folder / "client-ben.mcap").header.trial.startswith("motors tried with ")
