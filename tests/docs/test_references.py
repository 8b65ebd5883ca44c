"""Every reference in source, tests, settings and pages leads to something that exists.

Kinds: "theory 3.4" and "theory section 3.4" (docs/theory.md), "design: Server process" (docs/design.md),
"SPEC 5.4" and "SPEC.md section 5" (protocol/SPEC.md), "docs/NAME.md",
"docs/decisions/0003", "decision 3", "dev.py bench NAME", relative links of Markdown with their anchors, and on
pages modules such as `cogrip.protocol.laws.waves`.
"""

import os
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

from tests.docs.pages import DOCS, ROOT, anchor, headings, page, prose_lines
from tests.source_tree import FOLDERS

SUFFIXES = (".py", ".md", ".toml", ".service", ".rules")
SKIPPED = {"__pycache__", "build", "dist", "node_modules", "runs", "sweeps", "recordings"}

THEORY = re.compile(
    r"\btheory(?:\.md)?`?,?(?: sections?)? (\d+(?:\.\d+)*)(?:(?: and | or |, )(\d+\.\d+))?", re.IGNORECASE
)
DESIGN = re.compile(r"\bdesign: ([A-Z][\w ]*\w)")
SPEC_NUMBER = re.compile(
    r"\bSPEC(?:\.md)?`?\)?,?(?: sections?)? (\d+(?:\.\d+)*b?)(?:(?: and | or |, | to )(\d+(?:\.\d+)*))?"
)
FILE = re.compile(r"(?<![\w/])(docs/[\w./-]+\.(?:md|py|png|svg))\b")
DECISION_FILE = re.compile(r"\bdecisions/(\d{4})(?![\w-]*\.md)")
DECISION = re.compile(r"\bdecisions? (\d{1,2})\b")
BENCH = re.compile(r"\b(?:dev\.py|cogrip) bench (\w+)")
LINK = re.compile(r"(?<!!)\[[^]]*\]\(([^)\s]+)\)|!\[[^]]*\]\(([^)\s]+)\)")
MODULE = re.compile(r"`cogrip((?:\.\w+)+)")
IN_ANY_FILE = re.compile(r"theory|design: |SPEC|docs/|decision|bench ", re.IGNORECASE)
"""Found in every line that holds a reference of the kinds above, but for links and modules."""


def files() -> Iterator[Path]:
    """Yield the project's text files, without environments, caches and what runs leave."""
    for folder, names, found in os.walk(ROOT):
        names[:] = sorted(name for name in names if name not in SKIPPED and not name.startswith("."))
        yield from (Path(folder, name) for name in sorted(found) if name.endswith(SUFFIXES))


@cache
def titles(name: str) -> tuple[str, ...]:
    return tuple(headings(page(name)))


@cache
def numbered(name: str) -> frozenset[str]:
    """Return the section numbers of a page."""
    return frozenset(found[1] for title in titles(name) if (found := re.match(r"(\d+(?:\.\d+)*b?)\.? ", title)))


@cache
def anchors(path: Path) -> frozenset[str]:
    return frozenset(anchor(title) for title in headings(path.read_text(encoding="utf-8")))


@cache
def decisions() -> frozenset[int]:
    return frozenset(int(path.name[:4]) for path in DOCS.glob("decisions/[0-9]*.md"))


def named(title: str, name: str) -> bool:
    """Return True where a heading of the page begins with `title`, whatever number it has."""
    return any(re.sub(r"^[\d.]+b? ", "", each).lower().startswith(title.lower()) for each in titles(name))


@cache
def module_exists(dotted: str) -> bool:
    """Return True for a module of ours, or a name in one; `dotted` without "cogrip."."""
    parts = dotted.split(".")
    if parts[0] not in FOLDERS:
        return False
    path = ROOT / parts[0] / "cogrip"
    for at, part in enumerate(parts):
        if (path / part).is_dir():
            path = path / part
            continue
        module = path / f"{part}.py"
        rest = parts[at + 1 :] if module.is_file() else parts[at:]
        text = (module if module.is_file() else path / "__init__.py").read_text(encoding="utf-8")
        return all(re.search(rf"\b{name}\b", text) for name in rest)
    return True


def unresolved_link(path: Path, target: str) -> bool:
    if re.match(r"[a-z]+:", target):
        return False
    name, _, mark = target.partition("#")
    found = (path.parent / name).resolve() if name else path
    return not found.exists() or bool(mark and mark not in anchors(found))


def unresolved_in_line(line: str) -> Iterator[str]:
    """Yield each reference of a line that leads nowhere, of the kinds that any file may hold."""
    for pattern, name in ((THEORY, "docs/theory.md"), (SPEC_NUMBER, "protocol/SPEC.md")):
        for found in pattern.finditer(line):
            if not {each for each in found.groups() if each} <= numbered(name):
                yield found[0]
    yield from (found[0] for found in DESIGN.finditer(line) if not named(found[1], "docs/design.md"))
    yield from (found[0] for found in FILE.finditer(line) if not (ROOT / found[1]).exists())
    for found in (*DECISION_FILE.finditer(line), *DECISION.finditer(line)):
        if int(found[1]) not in decisions():
            yield found[0]
    for found in BENCH.finditer(line):
        known = f'"{found[1]}"' in page("tests/bench/__main__.py")
        if not found[1].isupper() and (found[0].startswith("cogrip") or not known):
            yield found[0]


def unresolved_on_page(path: Path, line: str) -> Iterator[str]:
    """Yield each link and module in a line of Markdown that leads nowhere."""
    for found in LINK.finditer(line):
        target = found[1] or found[2]
        if unresolved_link(path, target):
            yield target
    yield from (found[0] for found in MODULE.finditer(line) if not module_exists(found[1][1:]))


def unresolved(path: Path) -> Iterator[tuple[int, str]]:
    """Yield (line number, reference) of each reference that leads nowhere."""
    text = path.read_text(encoding="utf-8")
    for number, line in enumerate(text.splitlines(), 1):
        if IN_ANY_FILE.search(line):
            yield from ((number, reference) for reference in unresolved_in_line(line))
    if path.suffix == ".md":
        for number, line in prose_lines(text):
            yield from ((number, reference) for reference in unresolved_on_page(path, line))


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_every_reference_leads_to_something(suffix: str) -> None:
    this = Path(__file__).resolve()
    lost = [
        f"{path.relative_to(ROOT)}:{number}: {reference}"
        for path in files()
        if path.suffix == suffix and path != this and path.name != "CHANGELOG.md"
        for number, reference in unresolved(path)
    ]
    assert lost == [], "\n".join(["references that lead nowhere:", *lost])


def test_references_are_found() -> None:
    """A pattern that finds nothing would pass everything."""
    everything = "\n".join(path.read_text(encoding="utf-8") for path in files() if path != Path(__file__).resolve())
    for pattern in (THEORY, DESIGN, SPEC_NUMBER, FILE, DECISION, BENCH, LINK, MODULE):
        found = pattern.search(everything)
        assert found, pattern.pattern
        assert pattern in (LINK, MODULE) or IN_ANY_FILE.search(found[0])
    assert len(THEORY.findall(everything)) > 50


def test_every_page_is_in_the_index() -> None:
    index = page("docs/README.md")
    for path in sorted(DOCS.glob("**/*.md")):
        if path.name != "README.md":
            assert f"({path.relative_to(DOCS).as_posix()})" in index, path.name
