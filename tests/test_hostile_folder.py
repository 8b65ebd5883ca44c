"""No code of the folder that somebody happens to stand in runs as part of cogrip: real processes among hostile files."""

import ast
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from msgspec.structs import replace

from cogrip.cli.settings.settings_file import load
from cogrip.cli.settings.shipped_settings import shipped
from cogrip.results.writing.laboratory_run import run_laboratory

ROOT = Path(__file__).resolve().parents[1]
FOLDERS = ("machine", "protocol", "devices", "client", "server", "sim", "results", "analysis", "experiments", "cli")
LIMIT_S = 120.0
HOSTILE = (
    "json", "msgspec", "numpy", "struct", "pickle", "zlib", "mcap", "zstandard", "prometheus_client", "http", "threading",
    "multiprocessing", "tempfile", "signal", "random", "select", "mmap", "cogrip", "serial", "rich", "logging", "platform",
)  # fmt: skip
# As the installed `cogrip` is begun: by a file elsewhere, whose own folder stands first in the path.
SCRIPT = "import sys\nfrom cogrip.cli.main import main\nif __name__ == '__main__':\n    sys.exit(main())\n"
NO_PLOTS = "from cogrip.results.report import page\npage.draw_plots = lambda run: []\n"
ONE_PLOT = "from cogrip.results.plots import registry\nregistry.PLOTS = registry.PLOTS[:1]\n"
AT_ONCE = "import os, cogrip.cli.runs.replay as at\nat.WORTH_WORKERS_BYTES, os.cpu_count = 0, lambda: 2\n"
GUARD = """
import os, pty, tty
from cogrip.devices.family.haply import goodbye
from cogrip.devices.haply.frames import HaplyCodec
from cogrip.devices.haply.models import MODELS
from cogrip.devices.io.guarded_line import GuardedLine
keep, end = pty.openpty()
tty.setraw(end)
port = GuardedLine(os.ttyname(end), "haply", lambda: goodbye(HaplyCodec(MODELS["2diy"].wiring, 1)))
port.open()
port.close()
print("guarded")
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Full of modules that leave a mark where they are imported, and fail."""
    folder = tmp_path / "here"
    folder.mkdir()
    for name in HOSTILE:
        (folder / f"{name}.py").write_text(
            f"open({str(tmp_path / 'ran')!r}, 'a').write({name + ' '!r})\nraise SystemExit(3)\n"
        )
    return folder


def ran_in(folder: Path, *arguments: object, code: str = SCRIPT, module: str = "") -> str:
    """Return what a process says that is started in the folder; none of the modules there was imported."""
    script = folder.parent / "bin" / "script.py"
    script.parent.mkdir(exist_ok=True)
    script.write_text(code)
    start = ["-m", module] if module else [str(script)]
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONSAFEPATH"}
    done = subprocess.run(
        [sys.executable, *start, *map(str, arguments)],
        cwd=folder, env=environment, capture_output=True, text=True, timeout=LIMIT_S, stdin=subprocess.DEVNULL,
    )  # fmt: skip
    mark = folder.parent / "ran"
    assert not mark.exists(), f"imported from the folder: {mark.read_text()}\n{done.stdout}{done.stderr}"
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.mark.skipif(sys.platform == "win32", reason="metrics are not served on Windows")
def test_a_server_with_its_metrics_and_its_recording(folder: Path, tmp_path: Path) -> None:
    said = ran_in(
        folder, "serve", shipped("demo"), "--port", 0, "--seconds", 0.5, "--metrics", 0, "--runs", tmp_path / "runs",
        code=ONE_PLOT + SCRIPT,
    )  # fmt: skip
    assert "metrics: http://127.0.0.1:" in said
    assert len(list((tmp_path / "runs").glob("*/server.mcap"))) == 1


@pytest.mark.long
def test_clients_that_a_command_starts_and_their_recordings(folder: Path, tmp_path: Path) -> None:
    config = tmp_path / "alone.toml"
    config.write_text('seconds = 0.5\n[[users]]\nname = "anna"\n')
    ran_in(folder, "demo", "--config", config, "--runs", tmp_path / "runs", code=NO_PLOTS + SCRIPT)
    assert len(list((tmp_path / "runs").glob("*/*.mcap"))) == 2


@pytest.mark.long
def test_workers_of_a_sweep(folder: Path, tmp_path: Path) -> None:
    said = ran_in(
        folder, "sweep", shipped("demo"), "--vary", "seed=1:2:2", "--set", "seconds=0.2", "--measure", "passive",
        "--out", tmp_path / "out", "--jobs", 1, "--json", "-",
    )  # fmt: skip
    assert json.loads(said)["computed"] == 2


@pytest.mark.long
def test_workers_of_a_replay_of_several(folder: Path, tmp_path: Path) -> None:
    run = tmp_path / "run"
    run.mkdir()
    run_laboratory(replace(load(shipped("demo")), seconds=0.3), run)
    assert "bit for bit" in ran_in(folder, "replay", run, "--verify", code=AT_ONCE + SCRIPT)


@pytest.mark.skipif(not hasattr(os, "pidfd_open"), reason="needs Linux: pseudo-terminals and pidfd")
def test_the_guard_of_a_haply(folder: Path) -> None:
    assert "guarded" in ran_in(folder, code=GUARD)


def test_the_command_line_as_a_module(folder: Path) -> None:
    # `python -m` looks the package up there itself; what it then imports is ours to say
    (folder / "cogrip.py").unlink()
    ran_in(folder, "--version", module="cogrip.cli")


def test_every_process_of_python_that_is_started_is_kept_from_its_folder() -> None:
    """`sys.executable` stands first in a command, and -P second."""
    found = []
    paths = [each for folder in (*FOLDERS, "tests/bench") for each in (ROOT / folder).rglob("*.py")]
    for path in (*paths, ROOT / "dev.py"):
        text = path.read_text(encoding="utf-8")
        for node in ast.walk(ast.parse(text)) if "sys.executable" in text else ():
            parts = getattr(node, "elts", []) or getattr(node, "args", [])
            if isinstance(parts, list) and len(parts) > 1 and ast.unparse(parts[0]) == "sys.executable":
                found.append((path.relative_to(ROOT).as_posix(), ast.unparse(parts[1])))
    assert len(found) >= 10
    assert [place for place in found if place[1] != "'-P'"] == []
