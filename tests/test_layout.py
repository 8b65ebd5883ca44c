"""The shape of the source tree, as far as no linter checks it."""

import ast
import re
import statistics
import sys
import tomllib
from collections.abc import Iterable
from fnmatch import fnmatch
from functools import cache
from importlib.metadata import packages_distributions
from itertools import chain
from pathlib import Path

import pytest

from tests.source_tree import FOLDERS

ROOT = Path(__file__).parents[1]
PACKAGES = [f"cogrip.{folder}" for folder in FOLDERS]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))

MOST_MEDIAN_LINES = 120
NOT_INSTALLED_BY_NAME = {"forcedimension_core": "forcedimension-core", "serial": "pyserial", "pylsl": "pylsl"}
"""Modules of packages that a platform or a Python may have to do without, and the package each is of."""
BY_NAME = {"hidapi", "psutil"}
"""Packages that no import names: a backend of the first is chosen as a port is opened; loky ends its workers by the second."""
QUESTION_WORDS = re.compile(r"(What|Who|Whose|Whether|Of)\b")
QUESTION_TEXTS = re.compile(rf"""["'][\s\\]*{QUESTION_WORDS.pattern}""")

# Hosts that serve packages. A file that names one ties every user to it. Joined here, so that this file names none.
PACKAGE_HOSTS = [
    parts.replace(" ", ".")
    for parts in ("pypi org", "pythonhosted org", "npmjs org", "npmjs com", "yarnpkg com", "deb debian org",
                  "proxy golang org", "crates io", "conda anaconda org")
]  # fmt: skip


@cache
def repository_files() -> list[Path]:
    """Return the files that could be committed: all but what `.gitignore` and its like name, and the history itself."""
    lines = (ROOT / ".gitignore").read_text(encoding="utf-8").splitlines()
    patterns = [".git", *(line.rstrip("/") for line in lines if line and not line.startswith("#"))]
    assert not [each for each in patterns if "/" in each.strip("/") or each.startswith("!")], "this reads names alone"

    def files(folder: Path) -> list[Path]:
        found = []
        for path in sorted(folder.iterdir()):
            names = (path.name, f"/{path.relative_to(ROOT).as_posix()}")
            if any(fnmatch(name, pattern) for name in names for pattern in patterns):
                continue
            found += files(path) if path.is_dir() and not path.is_symlink() else [path] if path.is_file() else []
        return found

    return files(ROOT)


def test_what_commands_leave_in_the_current_folder_is_not_committed() -> None:
    lines = (ROOT / ".gitignore").read_text(encoding="utf-8").splitlines()
    assert {"/runs/", "/studies/", "/sweeps/", "/comparison.html"} <= {*lines}


@cache
def modules(*folders: str) -> dict[str, str]:
    """Return the source of each module below these folders, by its path."""
    paths = [path for folder in folders for path in (ROOT / folder).rglob("*.py")]
    return {path.relative_to(ROOT).as_posix(): path.read_text(encoding="utf-8") for path in paths}


def requirement_names(requirements: list[str]) -> set[str]:
    return {re.split(r"[^\w.-]", line, maxsplit=1)[0].lower() for line in requirements}


@pytest.mark.parametrize("folder", FOLDERS)
def test_folder_holds_its_portion_of_the_namespace_and_nothing_beside_it(folder: str) -> None:
    """`cogrip` is a PEP 420 namespace: one `cogrip/__init__.py` would hide the other folders."""
    assert [path.name for path in (ROOT / folder).glob("*.py")] == []
    assert [path.name for path in (ROOT / folder / "cogrip").glob("*.py")] == []
    portions = {path.parent.name for path in (ROOT / folder / "cogrip").glob("*/__init__.py")}
    assert portions == {folder}


def test_every_package_is_known_to_the_tools() -> None:
    portions = {f"cogrip.{path.parent.name}" for path in ROOT.glob("*/cogrip/*/__init__.py")}
    assert portions == set(PACKAGES)
    tool = PROJECT["tool"]
    assert set(tool["importlinter"]["root_packages"]) == portions
    layers = next(contract for contract in tool["importlinter"]["contracts"] if contract["type"] == "layers")
    assert {name.strip() for layer in layers["layers"] for name in layer.split("|")} == portions
    assert tool["hatch"]["build"]["dev-mode-dirs"] == list(FOLDERS)
    assert tool["hatch"]["build"]["targets"]["wheel"]["packages"] == [f"{folder}/cogrip" for folder in FOLDERS]
    assert tool["mypy"]["mypy_path"] == list(FOLDERS)
    assert set(FOLDERS) <= set(tool["mypy"]["files"])


def test_a_package_names_modules_that_it_has() -> None:
    """A word in backticks in a package's docstring is a module or package below it, where it is written like one."""
    others = {"cogrip", "forcedimension_core"}  # the command, and a library of a device's maker
    wrong = []
    for source in sorted(ROOT.glob("*/cogrip/**/__init__.py")):
        below = {each.stem for each in source.parent.rglob("*")}
        named = re.findall(r"`([a-z][a-z0-9_]*)`", ast.get_docstring(ast.parse(source.read_text("utf-8"))) or "")
        wrong += [f"{source.relative_to(ROOT)}: {name}" for name in named if name not in below | others]
    assert not wrong


def test_drivers_are_the_same_in_both_contracts() -> None:
    """A module that may touch a socket or a clock must also be out of reach for the cores."""
    contracts = PROJECT["tool"]["importlinter"]["contracts"]
    excused = next(contract for contract in contracts if "asyncio" in contract.get("forbidden_modules", []))
    protected = next(contract for contract in contracts if contract["type"] == "protected")
    drivers = {line.split(" -> ")[0].removesuffix(".**") for line in excused["ignore_imports"]}
    assert drivers == set(protected["protected_modules"])
    knows_of_stop = {"cogrip.results.writing.laboratory_run"}
    makes_drivers = {"cogrip.devices.family.*"}
    tries_files = {"cogrip.server.worlds.scenes.scene_file"}
    others = knows_of_stop | makes_drivers | tries_files | {"cogrip.cli", "cogrip.api"}
    assert set(protected["allowed_importers"]) <= drivers | others


def imported(source: str) -> set[str]:
    """Return the top-level modules that a source imports, wherever it does."""
    found = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            found |= {each.name.partition(".")[0] for each in node.names}
        elif isinstance(node, ast.ImportFrom) and not node.level and node.module:
            found.add(node.module.partition(".")[0])
    return found


def declared(lines: Iterable[str]) -> set[str]:
    """Return the distributions that requirements name."""
    return {canonical(re.match(r"[\w.-]+", line)[0]) for line in lines}  # type: ignore[index]


def canonical(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()


def test_what_is_imported_is_declared_and_what_is_declared_is_imported() -> None:
    """A package that comes along with another one may go when that one does without it."""
    project = PROJECT["project"]
    always, extras = declared(project["dependencies"]), declared(chain(*project["optional-dependencies"].values()))
    found = set().union(*(imported(source) for source in modules(*FOLDERS).values()))
    foreign = found - sys.stdlib_module_names - {"cogrip"}
    installed = packages_distributions()
    of = {name: {canonical(each) for each in installed.get(name, [name])} for name in foreign}
    of |= {
        name: {wanted} for name, wanted in NOT_INSTALLED_BY_NAME.items() if name in foreign and name not in installed
    }
    undeclared = {name: names for name, names in of.items() if not names & (always | extras)}
    assert not undeclared
    assert always <= set().union(*of.values()) | BY_NAME


def test_half_of_the_product_modules_are_short() -> None:
    counts = [len(source.splitlines()) for source in modules(*FOLDERS).values()]
    assert statistics.median(counts) < MOST_MEDIAN_LINES


def test_docstrings_say_what_a_thing_is_or_does() -> None:
    """They begin with a verb or a noun phrase, not with a question or a part of a sentence."""
    found = []
    for name, source in modules(*FOLDERS, "tests").items():
        for node in ast.walk(ast.parse(source)) if QUESTION_TEXTS.search(source) else ():
            if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
                text = ast.get_docstring(node) or ""
                if QUESTION_WORDS.match(text):
                    found.append(f"{name}:{getattr(node, 'lineno', 1)}: {text.splitlines()[0]}")
    assert not found, "\n".join([f"{len(found)} docstrings:", *found])


def test_no_file_names_a_package_host() -> None:
    pattern = re.compile("|".join(map(re.escape, PACKAGE_HOSTS)).encode())
    named = {
        path.relative_to(ROOT).as_posix(): match[0].decode()
        for path in repository_files()
        if (match := pattern.search(path.read_bytes()))
    }
    assert named == {}


def test_lock_holds_every_dependency_by_hash_and_no_address() -> None:
    lock = (ROOT / "requirements.lock").read_text(encoding="utf-8")
    assert "://" not in lock
    assert "--index" not in lock
    assert "--find-links" not in lock
    pinned = {match[1] for match in re.finditer(r"^([\w.-]+)==\S+( ;.*)? \\\n +--hash=sha256:", lock, re.MULTILINE)}
    groups = PROJECT["dependency-groups"]
    wanted = requirement_names(PROJECT["project"]["dependencies"] + groups["build"] + groups["dev"])
    assert wanted <= pinned


def test_lock_installs_a_package_only_where_the_project_asks_for_it() -> None:
    """`dev.py setup` failed on Python 3.13: a package that refuses it stood in the lock without a marker."""
    lock = (ROOT / "requirements.lock").read_text(encoding="utf-8")
    extras = [each for extra in PROJECT["project"]["optional-dependencies"].values() for each in extra if ";" in each]
    assert {re.split(r"[^\w-]", each, maxsplit=1)[0] for each in extras} >= {"ray", "forcedimension-core"}
    for each in extras:
        name, version = re.split(r"[^\w-]", each, maxsplit=1)[0], each.rpartition("'")[0].rpartition("'")[2]
        assert re.search(rf"^{name}==\S+ ; .*python_full_version < '{version}'.* \\$", lock, re.MULTILINE), each


CORES = ("machine", "protocol", "devices", "client", "server")
BY_BLAS = {"dot", "vdot", "inner", "outer", "matmul", "tensordot", "einsum", "linalg"}
"""Functions of numpy that add in an order, or round, as the processor likes it."""
NOT_REPLAYED = {  # computed before a session, or from its results
    "devices/cogrip/devices/arm/identification.py", "devices/cogrip/devices/motor_trial.py",
    "devices/cogrip/devices/response.py",
    "server/cogrip/server/worlds/conformance.py",
    "server/cogrip/server/worlds/scenes/scene_file.py",
}  # fmt: skip


def test_floats_are_added_in_one_order_by_every_python() -> None:
    """From Python 3.12 on `sum` of floats is compensated: no recording of 3.11 plays again where a core calls it."""
    found = [
        f"{name}:{node.lineno}: use add_floats or add_integers of cogrip.machine.addition"
        for name, source in modules(*FOLDERS).items()
        if "sum" in source and name != "machine/cogrip/machine/addition.py"
        for node in ast.walk(ast.parse(source))
        if (isinstance(node, ast.Name) and node.id == "sum") or (isinstance(node, ast.alias) and node.name == "sumprod")
    ]
    assert not found, "\n".join(found)


def test_the_cores_multiply_matrices_in_one_order_on_every_processor() -> None:
    found = [
        f"{name}:{node.lineno}: use dot or turn of cogrip.server.worlds.world"
        for name, source in modules(*CORES).items()
        if ("numpy" in source or "mujoco" in source) and name not in NOT_REPLAYED
        for node in ast.walk(ast.parse(source))
        if (isinstance(node, ast.BinOp) and isinstance(node.op, ast.MatMult))
        or (isinstance(node, ast.Attribute) and node.attr in BY_BLAS and ast.unparse(node.value) in ("np", "numpy"))
        or (isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.func.attr == "dot")
    ]
    assert not found, "\n".join(found)
