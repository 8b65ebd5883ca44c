"""The driver that docs/devices.md teaches with is one that works, and another package's family is found and tried like ours."""

import importlib.util
import sys
import textwrap
import tomllib
from collections.abc import Callable, Iterator
from importlib.metadata import EntryPoint
from pathlib import Path
from types import ModuleType

import pytest

from cogrip.cli.main import main
from cogrip.devices import DeviceError, make, registry
from cogrip.devices.conformance import CHECKS, DeviceSubject

from tests.devices.held_device import opened

EXAMPLE = Path(__file__).parents[2] / "docs" / "examples" / "wheel_driver.py"


@pytest.fixture(scope="module")
def example() -> ModuleType:
    spec = importlib.util.spec_from_file_location("wheel_driver", EXAMPLE)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture
def installed(example: ModuleType, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Pretend that a package with this entry point, and one that claims a scheme of ours, were installed."""
    monkeypatch.setitem(sys.modules, "wheel_driver", example)
    points = [EntryPoint(scheme, "wheel_driver:family", registry.GROUP) for scheme in ("wheel", "sim")]
    monkeypatch.setattr(registry, "entry_points", lambda group: points if group == registry.GROUP else [])
    registry.schemes.cache_clear()
    yield
    registry.schemes.cache_clear()


@pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.__name__)
def test_the_example_keeps_every_promise(check: Callable[[DeviceSubject], None], example: ModuleType) -> None:
    ports = []

    def wheel() -> object:
        ports.append(example.EmulatedWheel())
        return example.Wheel(ports[-1])

    check(DeviceSubject(wheel, acting=lambda device: (-ports[-1].pushes_n,)))  # type: ignore[arg-type]


@pytest.mark.usefixtures("installed")
def test_a_family_of_another_package_is_found_and_cannot_replace_one_of_ours() -> None:
    assert make("sim:ideal").capability.family == "sim"
    device = opened("wheel:emulated")
    device.write((0.5,))
    assert device.read(1).position_m == (0.005,)
    assert registry.stand_ins()["wheel"] == ("wheel:emulated",)
    assert "wheel" in registry.families()
    with pytest.raises(DeviceError, match="wheel"):
        make("wheels:emulated")


def test_it_is_as_short_as_the_docs_say() -> None:
    code = [line for line in EXAMPLE.read_text().split("class EmulatedWheel")[0].splitlines() if line.strip()]
    assert len(code) <= 100


@pytest.mark.usefixtures("installed")
def test_its_stand_in_is_held_in_virtual_time_and_its_hardware_is_not(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The way of docs/devices.md: `lab` said of the stand-in that it is hardware."""
    given = "lab demo --set seconds=0.3 --json"
    lab = [*given.split(), str(tmp_path / "out.json")]
    assert main([*lab, "--device", "wheel:emulated"]) == 0
    assert main([*lab, "--device", "wheel:/dev/ttyACM0"]) == 2
    assert "is hardware, and virtual time would not wait for it" in capsys.readouterr().err
    assert main(["demo", "--allow-unstable", "--device", "wheel:emulated"]) == 2
    assert not any(map(registry.is_real, ("wheel:emulated", "wheel:emulated?x=1")))
    assert all(map(registry.is_real, ("wheel:x", "wheel:")))
    assert main(["devices", "conform", "wheel:emulated"]) == 0, "nobody is asked to press Enter"


def test_the_docs_give_its_whole_package() -> None:
    page = (EXAMPLE.parents[1] / "devices.md").read_text(encoding="utf-8")
    block = page.partition("pyproject.toml` that\n")[2].partition("```\n")[2].partition("```")[0]
    project = tomllib.loads(textwrap.dedent(block))
    assert project["project"]["entry-points"][registry.GROUP] == {"wheel": "wheel_driver:family"}
    assert project["project"].keys() >= {"name", "version"}
