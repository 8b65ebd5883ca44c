"""The package for .NET and Unity by Mono, over the shared library: compiled, and in a session beside a Python client."""

import json
import os
import re
import shutil
import subprocess
import tomllib
from pathlib import Path

import pytest

from tests.clients.abi import interface
from tests.clients.compiled import build, has_libssl, needs_compiler
from tests.docs.pages import page
from tests.extent import long
from tests.live.test_c_library import holds_a_cube_with_a_python_client
from tests.live.test_live_sessions import DEMO

ROOT = Path(__file__).parents[2]
PACKAGE, CLIENT_TESTS = ROOT / "clients" / "csharp", ROOT / "tests" / "clients"
RUNTIME, EXAMPLE = sorted(PACKAGE.glob("Runtime/*.cs")), PACKAGE / "Example~" / "Example.cs"
COMPONENT, SCENE = PACKAGE / "Runtime/Unity/CogripSeat.cs", PACKAGE / "Samples~/OneHand/OneHand.unity"
SLEW_N = 1000.0 / 1024 * (1.0 + 1e-6)  # the steepest force, in a tick
LIMIT_S = 60.0

needs_mono = pytest.mark.skipif(
    not (shutil.which("mono") and shutil.which("mcs")), reason="no Mono: install mono-runtime and mono-mcs"
)


def compiled(out: Path, *arguments: str | Path, documented: bool = False) -> Path:
    """Compile C# 7: a warning fails, and with `documented` a public thing without a comment."""
    kind = "-target:library" if out.suffix == ".dll" else "-target:exe"
    documents = [f"-doc:{out.with_suffix('.xml')}"] if documented else []
    command = [
        "mcs",
        "-langversion:7",
        "-warn:4",
        "-warnaserror",
        kind,
        f"-out:{out}",
        *documents,
        *map(str, arguments),
    ]
    done = subprocess.run(command, capture_output=True, text=True, timeout=LIMIT_S, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return out


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with the package, the programs of the tests, and the library beneath `native`."""
    made = tmp_path_factory.mktemp("csharp")
    (made / "native").mkdir()
    encrypted = ["-lssl", "-lcrypto"] if has_libssl() else ["-DCOGRIP_NO_DTLS"]
    flags = ("-O1", "-fPIC", "-fvisibility=hidden", "-shared", "-DCOGRIP_SHARED")
    build(made / "native", "libcogrip.so", *flags, "cogrip.c", *encrypted)
    library = compiled(made / "Cogrip.dll", *RUNTIME, documented=True)
    compiled(made / "Example.exe", f"-r:{library}", EXAMPLE)
    compiled(made / "Probe.exe", *RUNTIME, CLIENT_TESTS / "probe.cs")
    return made


@pytest.fixture(scope="module")
def example(folder: Path) -> Path:
    """Return the example as a program that starts by its name."""
    program = folder / "example"
    program.write_text(f'#!/bin/sh\nexec mono "{folder}/Example.exe" "$@"\n', encoding="utf-8")
    program.chmod(0o755)
    return program


def said(
    folder: Path, *arguments: str, program: str = "Probe.exe", library: str = "native"
) -> subprocess.CompletedProcess:
    environment = {**os.environ, "LD_LIBRARY_PATH": str(folder / library)}
    command = ["mono", str(folder / program), *arguments]
    return subprocess.run(command, env=environment, capture_output=True, text=True, timeout=LIMIT_S, check=False)


@needs_mono
@needs_compiler
def test_a_person_by_csharp_and_one_by_python_hold_one_cube(
    run, serve, tmp_path: Path, folder: Path, example: Path
) -> None:
    native = folder / "native"
    found = holds_a_cube_with_a_python_client(run, serve, tmp_path, example, native, encrypted=has_libssl())
    assert found["peak_force_n"] > 0.02  # how long both are there together is the machine's affair
    assert found["rtt_ms"] > 0.0


@needs_mono
@needs_compiler
def test_a_device_that_throws_ends_at_no_force_and_says_so(serve, folder: Path) -> None:
    _, port = serve(DEMO, "--set", "link.delay_ms=0")
    done = said(folder, "fails", f"127.0.0.1:{port}")
    assert done.returncode == 0, done.stderr
    numbers, reason = done.stdout.splitlines()
    peak_n, step_n, last_n = map(float, numbers.split())
    assert peak_n > 0.0
    assert last_n == 0.0
    assert step_n <= SLEW_N
    assert reason.startswith("device: its ")


@needs_mono
@needs_compiler
def test_structs_are_laid_out_as_the_header_has_them(folder: Path) -> None:
    structs = interface()["structs"]
    places: dict[str, list[int]] = {"cogrip_config": [], "cogrip_status": []}
    for line in said(folder, "layout").stdout.splitlines():
        name, place = line.split()
        places[name].append(int(place))
    assert places["cogrip_config"] == [*structs["cogrip_config"].values()]
    status = structs["cogrip_status"]
    wanted = (
        "state",
        "safety",
        "axes",
        "device_hz",
        "network_hz",
        "seat",
        "tick",
        "impedance_nspm",
        "down",
        "room",
        "user",
    )
    assert places["cogrip_status"] == [*(status[name] for name in wanted), status[""]]


@needs_mono
@needs_compiler
def test_each_number_of_a_status_is_the_one_of_its_name(folder: Path) -> None:
    status, counts = (interface()["structs"][name] for name in ("cogrip_status", "cogrip_link_count"))
    down = {f"frames_{name}": status["down"] + place for name, place in counts.items()}
    for line in said(folder, "names").stdout.splitlines():
        name, *values = line.split()
        field = re.sub(r"(?<!^)(?=[A-Z])", "_", name).lower()
        begin = {**status, **down}[field]
        assert [int(value) for value in values] == [begin + 8 * axis for axis in range(len(values))], name


@needs_mono
@needs_compiler
def test_a_tick_takes_no_memory_of_the_collectors(folder: Path) -> None:
    during, control = map(int, said(folder, "garbage", "400000").stdout.split())
    assert control > 0
    assert during == 0


@needs_mono
@needs_compiler
@pytest.mark.parametrize(("target", "library", "why"), [
    ("[::1", "native", "as [ADDRESS]:PORT"),
    long("127.0.0.1:9", "native", "no server answered within 3 s"),
    ("127.0.0.1:9", "nowhere", "libcogrip was not found"),
])  # fmt: skip
def test_a_seat_that_cannot_be_had_says_why_in_one_line(folder: Path, target: str, library: str, why: str) -> None:
    done = said(folder, target, program="Example.exe", library=library)
    assert (done.returncode, done.stdout) == (1, "")
    assert why in done.stderr
    assert done.stderr.count("\n") == 1


@needs_mono
@needs_compiler
def test_every_public_thing_is_described_and_the_component_compiles(folder: Path, tmp_path: Path) -> None:
    """UnityEngine is a stand-in: nothing of the component is run."""
    library = folder / "Cogrip.dll"
    engine = compiled(tmp_path / "UnityEngine.dll", CLIENT_TESTS / "unity_engine.cs")
    references = (f"-r:{library}", f"-r:{engine}")
    compiled(
        tmp_path / "Cogrip.Unity.dll", "-nowarn:649", *references, COMPONENT, documented=True
    )  # 649: Unity gives them
    assert "T:Cogrip.SeatLoop" in library.with_suffix(".xml").read_text(encoding="utf-8")


PROGRAM = """
using System;
using Cogrip;
internal static class Page
{
    internal static void Hold(IHapticDevice device, Func<bool> stop, Action wait, Action<Vector, Vector> draw)
    {
%s
    }
}
"""
"""Lines around the block of C# of docs/csharp.md."""


@needs_mono
@needs_compiler
def test_the_program_of_the_page_compiles(folder: Path, tmp_path: Path) -> None:
    (block,) = re.findall(r"^```csharp\n(.*?)^```$", page("docs/csharp.md"), re.DOTALL | re.MULTILINE)
    (tmp_path / "Page.cs").write_text(PROGRAM % block, encoding="utf-8")
    compiled(tmp_path / "Page.dll", f"-r:{folder / 'Cogrip.dll'}", tmp_path / "Page.cs")


def metas() -> dict[Path, str]:
    """Return the identifier of each asset by its path."""
    found = {}
    for path in PACKAGE.rglob("*.meta"):
        identifier = re.search(r"^guid: ([0-9a-f]{32})$", path.read_text(encoding="utf-8"), re.MULTILINE)
        assert identifier, path
        found[path.with_suffix("")] = identifier[1]
    return found


def test_each_asset_of_the_unity_package_has_its_own_meta_file() -> None:
    """Unity leaves out assets of a package that have none."""
    hidden = {path for path in PACKAGE.rglob("*") if any(part.endswith("~") for part in path.parts)}
    assets = {path for path in PACKAGE.rglob("*") if path.suffix != ".meta"} - hidden
    assert assets | {SCENE} == set(metas())
    assert len(set(metas().values())) == len(metas())


def test_the_scene_refers_to_what_is_there() -> None:
    text = SCENE.read_text(encoding="utf-8")
    documents = re.findall(r"^--- !u!\d+ &(\d+)$", text, re.MULTILINE)
    assert len(set(documents)) == len(documents)
    assert {each for each in re.findall(r"\{fileID: (\d+)\}", text) if each != "0"} <= set(documents)
    component = re.search(r"^MonoBehaviour:\n(?:  .*\n)+", text, re.MULTILINE)
    assert component
    assert f"guid: {metas()[COMPONENT]}, type: 3" in component[0]
    fields = re.findall(r"^ +private \w+ (\w+)(?: =.*)?;$", COMPONENT.read_text(encoding="utf-8"), re.MULTILINE)
    shown = {name for name in fields if not name.startswith("_")}
    assert set(re.findall(r"^  ((?!m_)\w+):", component[0], re.MULTILINE)) == shown
    assert {"target", "tool"} <= shown


def test_the_package_has_the_version_of_the_project() -> None:
    version = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["version"]
    package = json.loads((PACKAGE / "package.json").read_text(encoding="utf-8"))
    assert package["version"] == version
    assert f"<Version>{version}</Version>" in (PACKAGE / "Cogrip.csproj").read_text(encoding="utf-8")
    assert (PACKAGE / package["samples"][0]["path"]) == SCENE.parent
    for path in PACKAGE.rglob("*.asmdef"):
        assert json.loads(path.read_text(encoding="utf-8"))["name"] == path.stem
