"""The bill of materials: what cogrip needs, at the versions of the lock, each with a licence; the same list for people."""

import json
import re
import tomllib
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).resolve().parents[1]
PARTS = {
    canonicalize_name(part["name"]): part for part in json.loads((ROOT / "sbom.cdx.json").read_text())["components"]
}


def test_it_has_what_the_project_needs_at_the_versions_of_the_lock() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    wanted = [Requirement(text) for text in project["dependencies"]]
    needed = {canonicalize_name(each.name) for each in wanted if each.marker is None or each.marker.evaluate()}
    assert needed <= set(PARTS), "write it again: python3 dev.py sbom"
    pinned = re.findall(r"^([\w.-]+)==([^\s;]+)", (ROOT / "requirements.lock").read_text(), re.MULTILINE)
    locked = {(canonicalize_name(name), version) for name, version in pinned}
    assert {(name, part["version"]) for name, part in PARTS.items()} <= locked, "write it again: python3 dev.py sbom"


def test_each_part_names_its_licence_and_the_page_says_the_same() -> None:
    page = (ROOT / "docs" / "licenses.md").read_text()
    for part in PARTS.values():
        assert part["licenses"], part["name"]
        assert f"| {part['name']} | {part['version']} | " in page
    assert "not named" not in page
    assert not re.search(r"file:|/home/|/tmp/", (ROOT / "sbom.cdx.json").read_text())
