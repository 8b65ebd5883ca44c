"""Wheels: the one for every platform, and the one that brings the compiled form (`HATCH_BUILD_HOOKS_ENABLE=1`)."""

import contextlib
import csv
import io
import os
import re
import shutil
import signal
import subprocess
import sys
import tomllib
import zipfile
from collections.abc import Iterator
from pathlib import Path

import compiling
import dev
import pytest
from hatchling.builders.wheel import WheelBuilder

from cogrip.machine import compiled_files
from cogrip.machine.compiled_files import CompiledModules

from tests.extent import long
from tests.free_ports import free_port

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
BUILT = "cogrip/machine/compiled/built"
TOUR = re.search(r"## A tour\n+```\n(.*?)```", (ROOT / "README.md").read_text("utf-8"), re.DOTALL)
FORM = "from cogrip.machine.compiled_files import form, why_interpreted; print(form(), why_interpreted())"


def build(folder: Path, monkeypatch: pytest.MonkeyPatch, compiled: bool) -> Path:
    """Build a wheel in this process. What a compiler makes is one library of a module that nothing imports."""

    def compile_into(built: Path) -> None:
        (library := folder / "0.so").touch()
        compiling.put({"cogrip.server.never": library}, built, compiled_files.fingerprint(), compiled_files.checksum())

    monkeypatch.setattr(compiling, "compile_into", compile_into)
    monkeypatch.setenv("HATCH_BUILD_HOOKS_ENABLE", "1" if compiled else "")
    return Path(next(WheelBuilder(str(ROOT)).build(directory=str(folder), versions=["standard"])))


def unpack(wheel: Path, folder: Path) -> Path:
    """Unpack a wheel as pip does: with the time at which that is done."""
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(folder)
    return folder


def said(site: Path, code: str) -> str:
    """Return what Python says that has a folder of packages ahead of all others, in a form that it chooses itself."""
    environment = {**os.environ, "PYTHONPATH": str(site), compiled_files.CHOSEN: ""}
    command = [sys.executable, "-P", "-c", code]
    return subprocess.run(command, env=environment, capture_output=True, text=True, check=True).stdout.strip()


def test_without_being_asked_a_wheel_is_for_every_platform(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    wheel = build(tmp_path, monkeypatch, compiled=False)
    assert wheel.name == f"cogrip-{PROJECT['project']['version']}-py3-none-any.whl"
    assert not [each for each in zipfile.ZipFile(wheel).namelist() if each.startswith(BUILT)]
    assert said(unpack(wheel, tmp_path / "site"), FORM) == "interpreted nothing was compiled"


def test_a_wheel_of_a_platform_brings_the_compiled_form_and_its_list_of_files_has_it(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    wheel = build(tmp_path, monkeypatch, compiled=True)
    python = f"cp{sys.version_info[0]}{sys.version_info[1]}"
    name, tag = f"cogrip-{PROJECT['project']['version']}", wheel.stem.split("-", 2)[2]
    assert tag.startswith(f"{python}-{python}-")
    assert not tag.endswith("-any")
    archive = zipfile.ZipFile(wheel)
    about = archive.read(f"{name}.dist-info/WHEEL").decode()
    assert f"Tag: {tag}\n" in about
    assert "Root-Is-Purelib: false\n" in about
    listed = {row[0] for row in csv.reader(io.StringIO(archive.read(f"{name}.dist-info/RECORD").decode()))}
    assert listed == set(archive.namelist())
    assert [each for each in listed if each.startswith(f"{BUILT}/form") and each.endswith(".json")]
    assert len([each for each in listed if each.startswith(BUILT)]) == 2


def test_an_installed_wheel_runs_compiled_until_a_source_changes(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """The times of its files are those of the installation, so contents count."""
    site = unpack(build(tmp_path, monkeypatch, compiled=True), tmp_path / "site")
    assert said(site, FORM) == "compiled"
    moved = site.rename(tmp_path / "moved")
    assert said(moved, FORM) == "compiled"
    copied = Path(shutil.copytree(moved, tmp_path / "copied", copy_function=shutil.copy))
    assert said(copied, FORM) == "compiled"
    source = moved / "cogrip" / "machine" / "histogram.py"
    text = source.read_text("utf-8")
    source.write_text(text.replace("=", "+", 1), "utf-8")  # as long as before
    assert said(moved, FORM) == f"interpreted {compiled_files.OTHERS}"
    source.write_text(text, "utf-8")
    assert said(moved, FORM) == "compiled"
    (moved / "cogrip" / "protocol" / "another.py").touch()
    assert said(moved, FORM) == f"interpreted {compiled_files.OTHERS}"
    next(copied.glob(f"{BUILT}/*/0*")).unlink()
    assert said(copied, FORM) == f"interpreted {compiled_files.NEVER}"


def test_a_checkout_and_its_wheel_have_the_same_sources(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    site = unpack(build(tmp_path, monkeypatch, compiled=False), tmp_path / "site")
    code = "from cogrip.machine.compiled_files import checksum, fingerprint; print(checksum(), *fingerprint()[:2])"
    number, size, _ = compiled_files.fingerprint()
    assert said(site, code) == f"{compiled_files.checksum()} {number} {size}"


def test_sources_are_read_only_where_their_times_differ(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    now, checksum = compiled_files.fingerprint(), compiled_files.checksum()
    assert CompiledModules(tmp_path, {}, now._replace(newest_ns=1), checksum).are_current()
    assert not CompiledModules(tmp_path, {}, now._replace(newest_ns=1), checksum + 1).are_current()
    monkeypatch.setattr(compiled_files, "checksum", lambda: pytest.fail("read"))
    assert CompiledModules(tmp_path, {}, now, 0).are_current()
    assert not CompiledModules(tmp_path, {}, now._replace(sources=now.sources + 1), checksum).are_current()
    assert not CompiledModules(tmp_path, {}, now._replace(size=now.size - 1), checksum).are_current()


def test_what_builds_wheels_agrees_on_pythons_and_how() -> None:
    project, built = PROJECT["project"], PROJECT["tool"]["cibuildwheel"]
    named = [each.rpartition(" ")[2] for each in project["classifiers"] if "Python :: 3." in each]
    assert list(dev.PYTHONS) == named
    assert built["build"].split() == [f"cp{each.replace('.', '')}-*" for each in named]
    assert built["environment"] == {"HATCH_BUILD_HOOKS_ENABLE": "1"}
    hook = PROJECT["tool"]["hatch"]["build"]["targets"]["wheel"]["hooks"]["custom"]
    assert sorted(hook["dependencies"]) == sorted(project["optional-dependencies"]["compile"])


@pytest.mark.parametrize(
    ("words", "said"),
    [(("2.7",), "wheel takes Pythons, of 3.11, 3.12, 3.13, 3.14, got '2.7'"), (("3.14", "x"), "got 'x'")],
)
def test_another_python_is_refused_in_one_line(words: tuple[str, ...], said: str) -> None:
    with pytest.raises(SystemExit, match=said):
        dev.wheel(*words)


SERVER = "--port {port} --state {folder}/state"
MORE = {
    "lab demo": "--set seconds=1", "advise demo": "", "demo lift": "--set seconds=1", "configs": "", "serve lan": SERVER,
    "join 127.0.0.1:47800": "--seconds 1", "who": SERVER, "devices list": "",
    "compare compare --profiles wifi --seeds 2": "--set seconds=2", "study fitts": "", "runs": "", "replay RUN --verify": "",
}  # fmt: skip
"""Commands of README's tour, and what shortens each of them."""


@pytest.mark.parametrize("python", [long(each) for each in dev.PYTHONS])
@pytest.mark.lasts(1800.0)
@pytest.mark.skipif(not compiling.has_compiler(), reason="no C compiler")
def test_the_tour_runs_compiled_from_the_wheel(python: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """As a newcomer has it: built, checked and named as for a release, installed where no checkout is on the path."""
    if dev.find_python(python) is None:
        pytest.skip(f"there is no Python {python} with pip here")
    monkeypatch.setattr(dev, "DIST", tmp_path / "dist")
    assert dev.wheel(python) == 0
    wheels = sorted((tmp_path / "dist").glob("*.whl"))
    assert [each.name.rpartition("-")[2] == "any.whl" for each in wheels].count(True) == 1
    (wheel,) = [each for each in wheels if not each.name.endswith("-any.whl")]
    assert "manylinux" in wheel.name or sys.platform != "linux"
    own = install(dev.find_python(python) or "", wheel, tmp_path)
    environment = {"PATH": f"{own}{os.pathsep}{os.defpath}", "HOME": str(tmp_path), "COLUMNS": "200"}
    tour(own / "cogrip", environment, tmp_path)
    tried = run(own / "cogrip", "doctor", environment, tmp_path)
    assert re.search(r"cogrip code +compiled\s", tried)


def install(python: str, wheel: Path, folder: Path) -> Path:
    """Install a wheel with the packages of the lock into an environment of its own. Return the folder of its commands."""
    subprocess.run([python, "-P", "-m", "venv", str(folder / "own")], check=True)
    (folder / "versions.txt").write_text("\n".join(dev.locked_versions()) + "\n")
    own = folder / "own" / "bin"
    pip = [str(own / "python"), "-P", "-m", "pip", "install", "--quiet", "--constraint", str(folder / "versions.txt")]
    subprocess.run([*pip, str(wheel)], check=True)
    return own


def run(cogrip: Path, words: str, environment: dict[str, str], folder: Path) -> str:
    """Run a command. Return what it says, where it ends by itself, without a verdict or with one."""
    done = subprocess.run(
        [str(cogrip), *words.split()],
        env=environment,
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=300.0,
        check=False,
    )
    assert done.returncode in (0, 1), f"{words}: {done.stderr}"
    assert "Traceback" not in done.stderr, words
    return done.stdout


def tour(cogrip: Path, environment: dict[str, str], folder: Path) -> None:
    """Run each command of README's tour, shortened; those after `serve` while the server runs."""
    assert TOUR
    lines = [line.partition("#")[0].strip().removeprefix("cogrip ") for line in TOUR[1].splitlines()]
    assert lines == list(MORE)
    port = free_port()
    with contextlib.ExitStack() as ends:
        for line in lines:
            words = f"{line} {MORE[line]}".format(port=port, folder=folder).replace(":47800", f":{port}")
            if line == "serve lan":
                ends.enter_context(serving([str(cogrip), *words.split()], environment, folder, port))
            elif line == "replay RUN --verify":
                name = next(each.name for each in sorted((folder / "runs").iterdir()) if each.name.endswith("-demo"))
                assert "equal, bit for bit" in run(cogrip, words.replace("RUN", name), environment, folder)
            else:
                run(cogrip, words, environment, folder)


@contextlib.contextmanager
def serving(command: list[str], environment: dict[str, str], folder: Path, port: int) -> Iterator[None]:
    """Have a server from its first line to Ctrl-C, after which it leaves a report."""
    with subprocess.Popen(
        command, env=environment, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    ) as server:
        try:
            assert server.stdout
            assert f":{port}, unencrypted" in server.stdout.readline()
            yield
            server.send_signal(signal.SIGINT)
            left, _ = server.communicate(timeout=60.0)
            assert server.returncode in (0, 1)
            assert "report: " in left
        finally:
            server.kill()
