"""`pip install cogrip` on every platform that docs/platforms.md names: a wheel of each package that is wanted there."""

import importlib.metadata
import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import NamedTuple

import dev
import pytest
from packaging.markers import Marker
from packaging.requirements import Requirement

from tests import forked
from tests.extent import long

ROOT = Path(__file__).parents[1]
LOCK = (ROOT / "requirements.lock").read_text(encoding="utf-8")
PYTHON = getattr(sys, "_base_executable", sys.executable)  # .venv has no pip
ENTRY = re.compile(r"^([\w.-]+)==(\S+?)(?: ; (.+?))? \\\n((?: .*\n)*)", re.MULTILINE)


class Platform(NamedTuple):
    """Platform of the page: tags of wheels, and what markers are asked.

    lacks  packages of the project that it has no wheel for
    """

    tags: tuple[str, ...]
    sys_platform: str
    machine: str
    lacks: frozenset[str] = frozenset()

    def environment(self, python: str) -> dict[str, str]:
        systems = {"linux": ("Linux", "posix"), "darwin": ("Darwin", "posix"), "win32": ("Windows", "nt")}
        system, os_name = systems[self.sys_platform]
        return {
            "sys_platform": self.sys_platform, "platform_machine": self.machine, "platform_system": system,
            "os_name": os_name, "python_version": python, "python_full_version": f"{python}.0", "extra": "",
            "implementation_name": "cpython", "platform_python_implementation": "CPython",
        }  # fmt: skip


PLATFORMS = {
    "macOS, Intel": Platform(("macosx_12_0_x86_64",), "darwin", "x86_64", frozenset({"mujoco-core"})),
    "Linux, x86-64": Platform(("manylinux_2_28_x86_64", "manylinux_2_17_x86_64", "manylinux2014_x86_64"), "linux", "x86_64"),
    "Linux, ARM64": Platform(("manylinux_2_28_aarch64", "manylinux_2_17_aarch64", "manylinux2014_aarch64"), "linux", "aarch64"),
    "Windows, ARM64": Platform(("win_arm64",), "win32", "ARM64", frozenset({"mujoco-core", "hidapi"})),
    "Windows, x86-64": Platform(("win_amd64",), "win32", "AMD64"),
    "macOS, ARM64": Platform(("macosx_12_0_arm64",), "darwin", "arm64"),
}  # fmt: skip


def wanted(platform: Platform, python: str) -> dict[str, str]:
    """Return name -> version of what the project and its dependencies want there, as locked."""
    environment = platform.environment(python)
    here: dict[str, str] = {}
    asked: dict[str, set[str]] = {}
    for name, version, marker, more in ENTRY.findall(LOCK):
        if not marker or Marker(marker).evaluate(environment):
            here[name] = version
            asked[name] = set(re.findall(r"^ +#(?: via)? +(\S+)$", more, re.MULTILINE))
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    dependencies = [Requirement(each) for each in project["dependencies"]]
    found = {each.name for each in dependencies if not each.marker or each.marker.evaluate(environment)}
    while more := {name for name, by in asked.items() if by & found} - found:
        found |= more
    return {name: here[name] for name in sorted(found & here.keys())}


def pip(*arguments: str) -> subprocess.CompletedProcess[str]:
    command = [PYTHON, "-P", "-m", "pip", "--disable-pip-version-check", "install", "--dry-run", "--quiet", "--no-deps"]
    return subprocess.run(
        [*command, "--ignore-installed", "--only-binary", ":all:", *arguments],
        capture_output=True, text=True, timeout=600.0, check=False,
    )  # fmt: skip


@pytest.mark.parametrize("python", ["3.11", long("3.14")])
@pytest.mark.parametrize("name", [each if each == "macOS, Intel" else long(each) for each in PLATFORMS])
def test_each_package_that_is_wanted_has_a_wheel(
    name: str, python: str, tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    platform = PLATFORMS[name]
    versions, found = wanted(platform, python), f"wheels/{name.replace(' ', '')}{python}"
    cache = None if request.config.getoption("--all") else request.config.cache
    if cache and cache.get(found, None) == versions:
        pytest.skip("each was found before, at these versions: no index takes a file back; --all asks again")
    requirements = tmp_path / "requirements.txt"
    requirements.write_text("".join(f"{each}=={version}\n" for each, version in versions.items()))
    tags = [word for tag in platform.tags for word in ("--platform", tag)]
    done = pip(
        *tags, "--python-version", python, "--implementation", "cp", "--target", str(tmp_path), "-r", str(requirements)
    )
    if done.returncode and (asked := pip("packaging")).returncode:
        pytest.skip(f"pip reaches no package here: {(asked.stderr.splitlines() or [''])[-1]}")
    assert done.returncode == 0, done.stderr
    if cache:
        cache.set(found, versions)


@pytest.mark.parametrize("name", PLATFORMS)
def test_what_has_no_wheel_is_not_wanted_and_all_else_is(name: str) -> None:
    platform, everywhere = PLATFORMS[name], wanted(PLATFORMS["Linux, x86-64"], "3.13")
    there = wanted(platform, "3.13").keys()
    assert everywhere.keys() - there == platform.lacks
    assert {"mujoco-core", "hidapi", "numpy", "psutil", "cryptography"} <= everywhere.keys()
    assert not {"pytest", "cython", "ray"} & everywhere.keys()
    assert there - everywhere.keys() <= {"colorama"}  # of Windows' terminals


def test_the_page_names_these_platforms_and_what_each_lacks() -> None:
    page = (ROOT / "docs" / "platforms.md").read_text(encoding="utf-8")
    for name, platform in PLATFORMS.items():
        (row,) = [line for line in page.splitlines() if line.startswith(f"| {name} |")]
        for package in ("mujoco-core", "hidapi"):
            assert (package in row) == (package in platform.lacks), row


WITHOUT = (
    "import sys; sys.modules.update(mujoco=None, hid=None, hidraw=None)\n"
    "from cogrip.cli.main import main; sys.exit(main(sys.argv[1:]))"
)


@pytest.mark.parametrize(
    ("command", "words"),
    [
        ("lab lift", "cogrip: lift: object.file: a scene needs the package mujoco-core, which is not installed"),
        ("serve lift --port 0", "a scene needs the package mujoco-core"),
        ("devices conform hid:woodenhaptics", "of the package hidapi"),
    ],
)
def test_what_is_missing_is_named_in_one_line(command: str, words: str) -> None:
    with forked.start(*command.split(), code=WITHOUT, env={**os.environ, "COLUMNS": "300"}) as process:
        said, _ = process.communicate(60.0)
    assert process.returncode in (1, 2), said
    (line,) = said.splitlines()
    assert words in line


def test_without_them_all_else_is_whole(tmp_path: Path) -> None:
    runs = ("--runs", str(tmp_path), "--set", "seconds=0.1")
    with forked.start("lab", "demo", *runs, code=WITHOUT) as process:
        said, _ = process.communicate(60.0)
    assert process.returncode in (0, 1), said  # so short, the cube has hardly moved
    assert "report: " in said
    assert "Traceback" not in said


def names_of(requirements: str) -> set[str]:
    return {re.sub(r"[-_.]+", "-", match[1]).lower() for match in ENTRY.finditer(requirements)}


def test_the_demonstration_waits_for_no_package_of_tests() -> None:
    """It installs all that cogrip requires, by what the installed packages themselves say, and no more."""
    project = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    own, whole = dev.own_requirements(LOCK, project), names_of(LOCK)
    needed, waiting = set[str](), ["cogrip", *tomllib.loads(project)["dependency-groups"]["build"]]
    while waiting:
        name = re.sub(r"[-_.]+", "-", Requirement(waiting.pop()).name).lower()
        if name in needed:
            continue
        needed.add(name)
        required = map(Requirement, importlib.metadata.requires(name) or ())
        waiting += [each.name for each in required if each.marker is None or each.marker.evaluate({"extra": ""})]
    assert needed - {"cogrip"} <= names_of(own)
    assert names_of(own).isdisjoint({"pytest", "mypy", "ray", "sphinx", "rosbags", "hypothesis", "cyclonedds"})
    assert names_of(own) < whole
    assert all(each[0] in LOCK for each in ENTRY.finditer(own)), "with their hashes"
