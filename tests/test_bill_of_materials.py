"""The bill of materials: what cogrip needs, at the versions of the lock, each with a licence; the same list for people."""

import json
import re
import tomllib
import zipfile
from importlib.metadata import PackageNotFoundError, requires
from pathlib import Path

from hatchling.builders.wheel import WheelBuilder
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).resolve().parents[1]
BILL = json.loads((ROOT / "sbom.cdx.json").read_text())
PARTS = {canonicalize_name(part["name"]): part for part in BILL["components"]}
MADE_ON = {"python_version": "3.11", "python_full_version": "3.11.0", "sys_platform": "linux", "extra": ""}
AGAIN = "write it again: python3 dev.py sbom"


def names(requirements: list[str]) -> set[str]:
    """Return the packages that are asked for where the bill is made."""
    wanted = [Requirement(text) for text in requirements]
    return {canonicalize_name(each.name) for each in wanted if each.marker is None or each.marker.evaluate(MADE_ON)}


def needed() -> set[str]:
    """Return what the project needs, and what that needs, as far as it is installed here."""
    found: set[str] = set()
    left = names(tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["dependencies"])
    while left:
        found.add(name := left.pop())
        try:
            left |= names(requires(name) or []) - found
        except PackageNotFoundError:  # on another Python than that of the bill
            continue
    return found


def vendored() -> set[tuple[str, str]]:
    """Return name and version of each library that the page holds."""
    table = (ROOT / "view/cogrip/view/static/vendor/README.md").read_text()
    return set(re.findall(r"^\| \S+ \| (\S+) \| ([\d.]+) \|", table, re.MULTILINE))


def test_it_has_all_that_the_project_needs_and_holds_at_the_versions_of_the_lock() -> None:
    pinned = re.findall(r"^([\w.-]+)==([^\s;]+)", (ROOT / "requirements.lock").read_text(), re.MULTILINE)
    locked = {(canonicalize_name(name), version) for name, version in pinned}
    found = {(name, part["version"]) for name, part in PARTS.items()}
    assert {name for name, _ in vendored()} == {"three", "uplot"}
    assert vendored() <= found, AGAIN
    assert found - vendored() <= locked, AGAIN
    assert needed() | {name for name, _ in vendored()} == set(PARTS), AGAIN


def test_each_part_names_its_licence_and_the_page_says_the_same() -> None:
    page = (ROOT / "docs" / "licenses.md").read_text()
    for part in PARTS.values():
        assert part["licenses"], part["name"]
        assert f"| {part['name']} | {part['version']} | " in page
    assert page.count("\n| ") == len(PARTS) + 1
    assert "not named" not in page
    assert not re.search(r"file:|/home/|/tmp/", (ROOT / "sbom.cdx.json").read_text())


def test_all_that_is_depended_on_is_a_part() -> None:
    parts = {part["bom-ref"] for part in BILL["components"]} | {BILL["metadata"]["component"]["bom-ref"]}
    assert {each["ref"] for each in BILL["dependencies"]} == parts
    assert {other for each in BILL["dependencies"] for other in each.get("dependsOn", ())} <= parts


def test_the_wheel_holds_it(tmp_path: Path) -> None:
    (wheel,) = WheelBuilder(str(ROOT)).build(directory=str(tmp_path), versions=["standard"])
    with zipfile.ZipFile(wheel) as files:
        (name,) = [each for each in files.namelist() if each.endswith(".dist-info/sboms/sbom.cdx.json")]
        assert json.loads(files.read(name)) == BILL
