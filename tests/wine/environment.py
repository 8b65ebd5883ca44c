"""Windows' own CPython 3.11 with the packages of the lock and this checkout's cogrip, in a folder, to run under Wine.

The parts are built here from what others publish, and nothing of it is committed: python311.dll and the standard `.pyd` files
are in the wheel of `panda3d` for Windows, as python.org ships them; the standard library's sources are those of the Python 3.11
that runs this; packages are their wheels for Windows. Compiled by MinGW are a `python.exe`, `python3.dll`, which forwards to
python311.dll, and what Wine 8 lacks: complex mathematics, and the random numbers of bcryptprimitives.dll.
"""

import re
import shutil
import subprocess
import sys
import sysconfig
import zipfile
from collections.abc import Iterable
from importlib.metadata import requires
from pathlib import Path
from tempfile import TemporaryDirectory

from packaging.requirements import Requirement

ROOT = Path(__file__).resolve().parents[2]
PYTHON_WHEEL = "panda3d==1.10.16"
VERSION = "3.11"
GCC, OBJDUMP = "x86_64-w64-mingw32-gcc", "x86_64-w64-mingw32-objdump"
NEEDED = ("wine", GCC, OBJDUMP)
MATHEMATICS, OWN_MATHEMATICS = "api-ms-win-crt-math-l1-1-0.dll", "opi-ms-win-crt-math-l1-1-0.dll"
"""Name of the library that numpy and scipy import complex functions from, and of one as long that has them."""
COMPLEX = re.compile(r"c(?:abs|arg|a?tanh?|a?cosh?|a?sinh?|exp|imag|log|pow|real|sqrt)[fl]?")
MARKERS = {
    "sys_platform": "win32", "platform_system": "Windows", "os_name": "nt", "platform_machine": "AMD64",
    "python_version": VERSION, "python_full_version": f"{VERSION}.9", "implementation_name": "cpython",
    "platform_python_implementation": "CPython", "extra": "",
}  # fmt: skip

PYTHON_EXE = """#include <windows.h>
int wmain(int argc, wchar_t **argv) {
    HMODULE python = LoadLibraryW(L"python311.dll");
    if (!python) return 99;
    return ((int (*)(int, wchar_t **))(void *)GetProcAddress(python, "Py_Main"))(argc, argv);
}
"""
RANDOM = """#include <windows.h>
BOOLEAN NTAPI SystemFunction036(PVOID, ULONG);
__declspec(dllexport) BOOL WINAPI ProcessPrng(PBYTE into, SIZE_T size) { return SystemFunction036(into, (ULONG)size); }
"""


def missing() -> list[str]:
    """Return what of the tools is not here, in words for people."""
    found = [f"no program {name}" for name in NEEDED if shutil.which(name) is None]
    return found + (
        []
        if sys.version_info[:2] == (3, 11)
        else [f"this is Python {sys.version_info[0]}.{sys.version_info[1]}, not {VERSION}"]
    )


def build(folder: Path) -> Path:
    """Return the python.exe of an environment in this folder, made anew. Raises CalledProcessError."""
    shutil.rmtree(folder, ignore_errors=True)
    packages = folder / "Lib" / "site-packages"
    packages.mkdir(parents=True)
    with TemporaryDirectory() as temporary:
        work = Path(temporary)
        _take_python(folder, work)
        _install(packages, work)
        python = _compile_python(folder, work)
        _mend_for_wine(folder, work)
    return python


def _take_python(folder: Path, work: Path) -> None:
    """Unpack python311.dll and the standard modules in C, and copy those in Python."""
    _pip("download", "--no-deps", "--platform", "win_amd64", "--python-version", VERSION, "--dest", work, PYTHON_WHEEL)
    (wheel,) = work.glob("panda3d-*.whl")
    (folder / "DLLs").mkdir()
    with zipfile.ZipFile(wheel) as archive:
        for name in archive.namelist():
            path = Path(name)
            if path.parent.name == "deploy_libs" and path.suffix in (".dll", ".pyd"):
                place = folder / "DLLs" if path.suffix == ".pyd" else folder
                (place / path.name).write_bytes(archive.read(name))
    skipped = shutil.ignore_patterns(
        "site-packages", "lib-dynload", "test", "tests", "__pycache__", "idlelib", "ensurepip"
    )
    shutil.copytree(sysconfig.get_path("stdlib"), folder / "Lib", ignore=skipped, dirs_exist_ok=True)


def _install(packages: Path, work: Path) -> None:
    """Install what cogrip needs on Windows, at the versions of the lock, and cogrip itself from its wheel."""
    pins = dict(
        re.findall(r"^([A-Za-z0-9_.-]+)==([^\s;\\]+)", (ROOT / "requirements.lock").read_text("utf-8"), re.MULTILINE)
    )
    names = sorted(_needed(["cogrip"]) - {"cogrip"})
    wanted = [f"{name}=={pins[name]}" for name in names]
    target = ("--target", packages, "--platform", "win_amd64", "--python-version", VERSION, "--implementation", "cp")
    _pip("install", "--no-deps", "--no-compile", *target, *wanted)
    _pip("wheel", "--no-deps", "--no-build-isolation", "--wheel-dir", work / "own", ROOT, only_binary=False)
    (own,) = (work / "own").glob("cogrip-*.whl")
    with zipfile.ZipFile(own) as archive:
        archive.extractall(packages)


def _needed(names: Iterable[str]) -> set[str]:
    """Return these packages and all that they require on Windows, by their canonical names."""
    found: set[str] = set()
    waiting = [_canonical(name) for name in names]
    while waiting:
        name = waiting.pop()
        if name in found:
            continue
        found.add(name)
        try:
            required = requires(name) or []
        except ModuleNotFoundError:  # one that Linux does without requires nothing that the others do not
            continue
        for text in required:
            each = Requirement(text)
            if each.marker is None or each.marker.evaluate(MARKERS):
                waiting.append(_canonical(each.name))
    return found


def _canonical(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()


def _compile_python(folder: Path, work: Path) -> Path:
    """Compile python.exe, and python3.dll, which forwards each name of python311.dll."""
    python = folder / "python.exe"
    _compile(PYTHON_EXE, python, work, "-municode")
    definitions = "\n".join(
        ["LIBRARY python3.dll", "EXPORTS", *(f"{each}=python311.{each}" for each in _exports(folder / "python311.dll"))]
    )
    (work / "python3.def").write_text(definitions + "\n", "utf-8")
    _compile("", folder / "python3.dll", work, "-shared", "-nostdlib", work / "python3.def")
    return python


def _mend_for_wine(folder: Path, work: Path) -> None:
    """Give the packages the mathematics and random numbers that Wine 8 lacks."""
    _compile(RANDOM, folder / "bcryptprimitives.dll", work, "-shared", "-ladvapi32")
    names: set[str] = set()
    for path in [*folder.rglob("*.pyd"), *folder.rglob("*.dll")]:
        code = path.read_bytes()
        if MATHEMATICS.encode() not in code:
            continue
        names.update(_imports(path, MATHEMATICS))
        path.write_bytes(code.replace(MATHEMATICS.encode(), OWN_MATHEMATICS.encode()))
    own = sorted(name for name in names if COMPLEX.fullmatch(name))
    kept = ", ".join(f"(void *){name}" for name in own)
    rows = [name if name in own else f"{name}=ucrtbase.{name}" for name in sorted(names)]
    (work / "mathematics.def").write_text("\n".join([f"LIBRARY {OWN_MATHEMATICS}", "EXPORTS", *rows]) + "\n", "utf-8")
    source = f"#include <complex.h>\nvoid *kept[] = {{{kept or '0'}}};\n"
    _compile(source, folder / OWN_MATHEMATICS, work, "-shared", work / "mathematics.def")


def _compile(source: str, into: Path, work: Path, *flags: str | Path) -> None:
    file = work / f"{into.stem}.c"
    file.write_text(source, "utf-8")
    libraries = [flag for flag in flags if str(flag).startswith("-l")]
    others = [str(flag) for flag in flags if flag not in libraries]
    subprocess.run(
        [GCC, "-O1", "-w", "-static-libgcc", *others, str(file), "-o", str(into), *map(str, libraries)], check=True
    )


def _exports(library: Path) -> list[str]:
    """Return the names that a library exports."""
    told = subprocess.run([OBJDUMP, "-p", str(library)], capture_output=True, text=True, check=True).stdout
    table = told.partition("[Ordinal/Name Pointer] Table")[2]
    return re.findall(r"\+base\[\s*\d+\]\s+\S+\s+(\w+)$", table, re.MULTILINE) or re.findall(
        r"\[\s*\d+\][^\n]*?\s(\w+)$", table, re.MULTILINE
    )


def _imports(library: Path, of: str) -> list[str]:
    """Return the names that a library imports from another one."""
    told = subprocess.run([OBJDUMP, "-p", str(library)], capture_output=True, text=True, check=True).stdout
    found: list[str] = []
    for part in re.split(r"^\s*DLL Name: ", told, flags=re.MULTILINE)[1:]:
        name, _, rest = part.partition("\n")
        if name.strip().lower() == of:
            found += re.findall(
                r"^\s+[0-9a-f]+\s+(?:<none>\s+)?(?:[0-9a-f]+\s+)?(\w+)\s*$", rest.partition("\n\n")[0], re.MULTILINE
            )
    return found


def _pip(*words: str | Path, only_binary: bool = True) -> None:
    binary = ("--only-binary", ":all:") if only_binary else ()
    asked = [str(word) for word in (words[0], *binary, *words[1:])]
    base = getattr(sys, "_base_executable", sys.executable)  # that of .venv has no pip
    pip = [base, "-P", "-m", "pip", "--python", sys.executable, "--disable-pip-version-check", "--quiet"]
    subprocess.run([*pip, *asked], check=True)
