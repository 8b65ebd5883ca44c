"""Files of the page: those of others are unchanged, ours are small, all are served and in the wheel, the policy fits."""

import re
from base64 import b64encode
from hashlib import sha256
from pathlib import Path

from hatchling.builders.wheel import WheelBuilder

from cogrip.view.page import STATIC, content_security_policy, self_contained, served_files

ROOT = Path(__file__).parents[2]
VENDOR = STATIC / "vendor"
MOST_LINES = 400
ROW = re.compile(r"^\| ([\w.]+) \| (\w+) \| ([\d.]+) \| (MIT)[^|]* \| ([0-9a-f]{64}) \|$", re.MULTILINE)
TABLE = {file: digest for file, _, _, _, digest in ROW.findall((VENDOR / "README.md").read_text(encoding="utf-8"))}


def test_files_of_others_are_those_of_the_table() -> None:
    files = {path.name for path in VENDOR.iterdir()} - {"README.md", ".gitattributes"}
    assert files == set(TABLE)
    assert {name: sha256((VENDOR / name).read_bytes()).hexdigest() for name in files} == TABLE


def test_modules_of_our_own_are_short_and_need_no_build() -> None:
    for path in STATIC.glob("*.js"):
        source = path.read_text(encoding="utf-8")
        assert len(source.splitlines()) <= MOST_LINES, path.name
        for imported in re.findall(r'from "([^"]+)"', source):
            assert imported in ("three", "uplot") or (STATIC / imported).is_file(), f"{path.name}: {imported}"


def test_all_files_are_served_with_their_types() -> None:
    files = served_files()
    assert files["/"].content_type == "text/html; charset=utf-8"
    assert (
        files["/main.js"].content_type
        == files["/vendor/three.core.min.js"].content_type
        == "text/javascript; charset=utf-8"
    )
    assert files["/view.css"].content == (STATIC / "view.css").read_bytes()
    assert "/index.html" not in files
    assert not [path for path in files if path.endswith((".md", ".txt", ".gitattributes"))]


def test_policy_allows_the_import_map_and_nothing_else_inline() -> None:
    index = served_files()["/"].content.decode()
    (inline,) = re.findall(r"<script[^>]*>([^<]+)</script>", index)
    assert b64encode(sha256(inline.encode()).digest()).decode() in content_security_policy()
    assert "unsafe" not in content_security_policy()
    assert not re.search(r"\sstyle=|\son\w+=|<style", index)


def test_nothing_names_an_address_elsewhere() -> None:
    for path in (*STATIC.glob("*.js"), STATIC / "view.css", STATIC / "index.html"):
        assert not re.search(r"(https?|wss?)://", path.read_text(encoding="utf-8")), path.name


def test_wheel_holds_the_page() -> None:
    held = {file.distribution_path for file in WheelBuilder(str(ROOT)).recurse_included_files()}
    paths = {path.relative_to(STATIC).as_posix() for path in STATIC.rglob("*") if path.is_file()}
    assert {f"cogrip/view/static/{path}" for path in paths} <= held


def test_self_contained_page_carries_the_licences() -> None:
    text = self_contained("{}", [])
    assert text.count("Permission is hereby granted, free of charge") == 2
    assert text.startswith("<!doctype html>")
