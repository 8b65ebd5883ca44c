"""Other systems: one module of a package knows them, and the rest runs on the stand-in for Windows (tests/windows.py)."""

import ast
import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.test_layout import FOLDERS, ROOT, modules

STAND_IN = ROOT / "tests" / "windows.py"
MACHINE = ROOT / "machine" / "cogrip" / "machine"
ASKING = re.compile(r"\bsys\.platform\b|\bos\.name\b|platform\.system\(")
ASKS = {  # modules that may ask which system this is
    "machine/cogrip/machine/posix.py", "machine/cogrip/machine/windows.py", "machine/cogrip/machine/platform.py",
    "machine/cogrip/machine/realtime.py", "machine/cogrip/machine/punctuality.py",  # Linux's measures
    "devices/cogrip/devices/io/platform.py", "devices/cogrip/devices/io/line_names.py",
    "machine/cogrip/machine/server_platform.py", "view/cogrip/view/io/platform.py",
    "cli/cogrip/cli/terminal/platform.py", "cli/cogrip/cli/terminal/screen.py", "cli/cogrip/cli/terminal/live_screen.py",
    "server/cogrip/server/io/state_folder.py",  # in a message
}  # fmt: skip
LIMIT_S = 300.0
linux = pytest.mark.skipif(sys.platform != "linux", reason="the stand-in for Windows runs on Linux")


def on_windows(*arguments: str, cwd: Path = ROOT) -> str:
    """Return what a process of the stand-in prints. It ends well."""
    command = [sys.executable, "-P", str(STAND_IN), *arguments]
    done = subprocess.run(command, cwd=cwd, capture_output=True, text=True, timeout=LIMIT_S, check=False)
    assert done.returncode == 0, done.stdout[-4000:] + done.stderr[-4000:]
    return done.stdout


def interface(path: Path) -> dict[str, list[str]]:
    """Return the public names of a module, and the parameters of its functions."""
    found: dict[str, list[str]] = {}
    for node in ast.parse(path.read_text(encoding="utf-8")).body:
        match node:
            case ast.FunctionDef(name=name, args=ast.arguments(args=positional, vararg=more)):
                found[name] = [each.arg for each in positional] + ([more.arg] if more else [])
            case ast.Assign(targets=[ast.Name(id=name)]) | ast.AnnAssign(target=ast.Name(id=name)):
                found[name] = []
    return {name: parameters for name, parameters in found.items() if not name.startswith("_")}


def test_both_systems_have_the_same_names() -> None:
    posix, windows = interface(MACHINE / "posix.py"), interface(MACHINE / "windows.py")
    assert posix.keys() == windows.keys()
    same = {"end": "interrupt", "datagram_pair": "message_pair"}  # on Windows one function under two names
    for name, parameters in posix.items():
        assert windows[same.get(name, name)] == parameters, name


def test_nobody_else_asks_which_system_this_is() -> None:
    asking = {name for name, source in modules(*FOLDERS).items() if ASKING.search(source)}
    assert asking == ASKS


IMPORT_ALL = """
import importlib, sys
import cogrip.cli.main
from pathlib import Path
failed = []
names = [
    ".".join(path.relative_to(Path(folder)).with_suffix("").parts).removesuffix(".__init__")
    for folder in sys.argv[2:] for path in sorted(Path(folder).rglob("*.py"))
]
for name in names:
    if name.endswith(("__main__", ".io.posix", "machine.posix", ".live_screen", ".ray_cluster")):
        continue
    try:
        importlib.import_module(name)
    except Exception as error:
        failed.append(f"{name}: {type(error).__name__}: {error}")
print(len(names), failed)
"""


@linux
def test_every_module_is_imported_without_what_windows_lacks() -> None:
    count, _, failed = on_windows("-c", IMPORT_ALL, *FOLDERS).partition(" ")
    assert failed.strip() == "[]"
    assert int(count) == len(modules(*FOLDERS))


SYSTEM = """
import tempfile
from cogrip.machine import pacing, platform, realtime, windows
from cogrip.protocol.io.recorder import is_being_written
from pathlib import Path
system = platform.system
assert system is windows

path = Path(tempfile.mkdtemp()) / "file"
with path.open("wb") as file:
    assert not is_being_written(path)
    system.lock(file.fileno())
    assert is_being_written(path)
    assert not system.removed(file.fileno())
assert not is_being_written(path)
path.unlink()

clock = platform.time.monotonic_ns
times = {clock() for _ in range(1000)}
assert len(times) > 500, "a clock of 15.6 ms would give one or two"
assert (pacing.SPIN_NS, pacing.SPIN_PART) == (600_000, 1)

measures = realtime.engage()
print({measure.name: (measure.granted, measure.detail) for measure in measures})
realtime.release(measures)
print([call for call in api_calls() if call[0] != "LockFileEx"])

ours, theirs = system.message_pair()
ours.send(b"one"), ours.send(b"two")
assert (theirs.recv(100), theirs.recv(100)) == (b"one", b"two")
theirs.close()
for end in range(2):
    try:
        ours.send(b"three")
    except system.NOBODY_LISTENS:
        break
else:
    raise AssertionError("an end does not learn that the other has gone")

try:
    system.copy(0, 1)
except OSError as error:
    print(error)
assert system.typed() == b"" and not system.has_terminal()
"""


@linux
def test_the_substitutes_do_what_they_stand_for() -> None:
    said = on_windows("-c", SYSTEM)
    measures, calls, _ = said.splitlines()
    assert ast.literal_eval(measures) == {
        "timer-slack": (True, "timer period 1 ms, sleep by a high-resolution timer"),
        "gc-frozen": (True, ast.literal_eval(measures)["gc-frozen"][1]),
        "memory-locked": (False, "not available: mlockall is only used on Linux, this is win32"),
        "cpu-awake": ast.literal_eval(measures)["cpu-awake"],
        "fifo": (True, "HIGH_PRIORITY_CLASS, THREAD_PRIORITY_TIME_CRITICAL"),
    }
    assert ast.literal_eval(calls) == [
        ("timeBeginPeriod", 1),
        *[("GetCurrentProcess",), ("GetPriorityClass", -1), ("GetCurrentThread",), ("GetThreadPriority", -2)],
        *[("GetCurrentProcess",), ("SetPriorityClass", -1, 0x80), ("GetCurrentThread",), ("SetThreadPriority", -2, 15)],
        *[("GetCurrentThread",), ("SetThreadPriority", -2, 0), ("GetCurrentProcess",), ("SetPriorityClass", -1, 0x20)],
        ("timeEndPeriod", 1),
    ]


NO_CONSOLE = """
import subprocess, sys
from cogrip.machine import windows

def no_console(self, number):  # as os.kill does: GenerateConsoleCtrlEvent fails, the process is ended, and an error is left
    self.terminate()
    raise SystemError("<built-in function kill> returned a result with an exception set")

subprocess.Popen.send_signal = no_console
child = subprocess.Popen([sys.executable, "-c", "import sys; sys.stdin.read()"], stdin=subprocess.PIPE)
windows.interrupt(child)
assert child.wait() != 0
child.stdin.close()
windows.interrupt(child)  # it has ended already
windows._kernel32.GetConsoleCP = lambda: 0
tethered = subprocess.Popen([sys.executable, "-c", "import sys; sys.stdin.read(); sys.exit(7)"], stdin=subprocess.PIPE)
windows.interrupt(tethered)
assert tethered.wait() == 7, "it ends by itself, in order"
windows.interrupt(tethered)
"""


@linux
def test_without_a_console_a_child_is_ended() -> None:
    on_windows("-c", NO_CONSOLE)


@linux
def test_examples_of_devices_have_names_as_the_system_has_them() -> None:
    expected = {
        "win32": ("serial:COM3?model=vintage", "haply:COM3?model=2diy", "spacemouse:"),
        "darwin": ("serial:/dev/tty.usbmodem101?model=vintage", "haply:/dev/tty.usbmodem101?model=2diy", "spacemouse:"),
        "linux": ("serial:/dev/ttyACM0?model=vintage", "haply:/dev/ttyACM0?model=2diy", "spacemouse:/dev/hidraw0"),
    }
    list_all = (
        "import sys\n"
        "from cogrip.devices.registry import describe, families\n"
        "sys.platform = sys.argv[1]\n"
        "import cogrip.devices.io.line_names\n"
        "sys.platform = 'linux'\n"
        "print(*[each.address for each in describe(axes=3)], *families().values(), sep='\\n')"
    )
    for system, addresses in expected.items():
        command = [sys.executable, "-P", "-c", list_all, system]
        said = subprocess.run(command, capture_output=True, text=True, timeout=LIMIT_S, check=True).stdout
        assert set(addresses) <= set(said.splitlines())
        assert ("/dev/hidraw" in said) == ("/dev/input" in said) == (system == "linux")
        assert ("/dev/ttyACM" in said) == (system == "linux")


COMMANDS = """
import json
from cogrip.cli.main import main
from cogrip.machine.punctuality import examine
from pathlib import Path

def run(*arguments, code=0):
    assert main([*arguments]) == code, arguments

run("lab", "demo", "--set", "seconds=0.5", "--runs", "runs")
(folder,) = Path("runs").iterdir()
run("replay", str(folder), "--verify")
run("view", str(folder), "--out", "page.html")
run("runs", "runs")
run("export", str(folder), "--to", "csv", "--out", "tables")
run("devices", "list")
run("gateway", "cogrip://somewhere", code=2)
run("serve", "lan", "--state", "state", code=2)
run("devices", "emulate", "serial", code=2)
run("devices", "emulate", "hid", code=2)
run("who", "--state", "state", code=1)
print("lacks:", json.dumps(examine().lacks))
"""


@pytest.mark.long
@linux
def test_commands_run_and_what_windows_cannot_is_refused_in_one_line(tmp_path: Path) -> None:
    said = on_windows("-c", COMMANDS, cwd=tmp_path)
    assert said.count("equal, bit for bit") == 3
    assert "HIGH_PRIORITY_CLASS" in said.partition("lacks:")[2]
    assert (tmp_path / "page.html").stat().st_size > 100_000
