"""The compiled form (`dev.py compile`): it is removed where its sources change, and gives the same numbers."""

import ast
import importlib
import json
import os
import re
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path
from types import ModuleType, SimpleNamespace

import compiling
import dev
import pytest

from cogrip.cli.main import main
from cogrip.machine import compiled_files
from cogrip.machine.compiled_files import compiled_modules, form

ROOT = Path(__file__).parent.parent
LAWS = (
    "tests/protocol/test_line.py", "tests/protocol/test_energy_sums.py", "tests/protocol/test_concealment.py",
    "tests/protocol/test_jitter_buffer.py", "tests/protocol/test_clock.py", "tests/protocol/test_button_edges.py",
    "tests/machine/test_ring.py", "tests/machine/test_histogram.py", "tests/server/test_grip_world.py",
    "tests/server/test_seat_limits.py", "tests/server/test_rate_limit.py", "tests/server/test_dtls_channel.py",
    "tests/server/test_recorded_server_plays_again.py", "tests/results/test_recorded_sessions.py",
    "tests/protocol/test_decimation.py", "tests/protocol/test_wave_filter.py", "tests/client",
    "tests/devices/test_simulated_hands.py", "tests/devices/test_simulated_plants.py", "tests/devices/test_plausibility.py",
)  # fmt: skip


def test_every_type_file_has_its_module() -> None:
    found = compiling.sources()
    assert all(source.exists() for _, source in found)
    assert compiled_files.PARTS == compiling.PARTS
    names = {name for name, source in found if source.suffix == ".py"}  # others are there only compiled
    assert set(compiled_modules()) == {name for name, _ in found}
    for name in names:
        module = importlib.import_module(name)
        assert compiled_modules()[name] is not str(module.__file__).endswith(".py"), "of the form that is said"


def test_the_form_is_that_of_every_module(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    folder, types = tmp_path / "protocol", tmp_path / "compiled" / "cogrip" / "protocol"
    folder.mkdir()
    types.mkdir(parents=True)
    monkeypatch.setattr(compiled_files, "folders_of_parts", lambda: {"cogrip.protocol": folder})
    monkeypatch.setattr(compiled_files, "types_folder", lambda: tmp_path / "compiled")
    for place in (
        folder / "clock.py",
        folder / "waves.py",
        folder / "sender.py",
        types / "clock.pxd",
        types / "sender.pxd",
    ):
        place.touch()
    assert compiled_modules() == {"cogrip.protocol.clock": False, "cogrip.protocol.sender": False}
    assert form() == "interpreted"
    (folder / f"sender{compiling.SUFFIX}").touch()
    assert form() == "partly compiled: 1 of 2 modules"
    (folder / f"clock{compiling.SUFFIX}").touch()
    assert form() == "compiled"


def test_a_folder_called_cogrip_beside_a_script_is_none_of_ours(tmp_path: Path) -> None:
    """Python takes it into the namespace: a checkout with its environment, or any folder with libraries in it."""
    foreign = tmp_path / "cogrip" / ".venv" / "Cython"
    foreign.mkdir(parents=True)
    for name, seconds in ((f"Scanning{compiling.SUFFIX}", 1000), ("Scanning.pxd", 1000), ("Shadow.py", 1001)):
        (foreign / name).touch()
        os.utime(foreign / name, (seconds, seconds))
    server = tmp_path / "cogrip" / "server"  # as in a checkout: a folder, and no package
    server.mkdir()
    shutil.copy(foreign / f"Scanning{compiling.SUFFIX}", server)
    script = tmp_path / "script.py"
    script.write_text(
        "import cogrip\n"
        "from cogrip.machine.compiled_files import compiled_modules, outdated\n"
        "print(cogrip.__path__[0])\n"
        "print(*compiled_modules(), *outdated())\n"
    )
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONSAFEPATH"}
    ran = subprocess.run([sys.executable, script], capture_output=True, text=True, check=True, env=environment)
    assert ran.stdout.splitlines() == [str(tmp_path / "cogrip"), " ".join(compiled_modules())]


def test_an_installation_by_pip_is_compiled_by_its_own_command(monkeypatch: pytest.MonkeyPatch) -> None:
    assert compiled_files.compile_command() == "python3 dev.py compile"
    monkeypatch.setitem(sys.modules, "cogrip.cli.compiling", ModuleType("cogrip.cli.compiling"))
    sys.modules["cogrip.cli.compiling"].__spec__ = SimpleNamespace()  # type: ignore[assignment]
    assert compiled_files.compile_command() == "cogrip compile"


def test_what_is_compiled_of_older_sources_is_stale(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(compiling, "STAMP", tmp_path / "stamp.json")
    monkeypatch.setattr(compiling, "ROOT", tmp_path)
    (tmp_path / "client/cogrip").mkdir(parents=True)
    assert not compiling.stale()
    (tmp_path / "client/cogrip/loop.cpython-311.so").touch()
    assert compiling.stale(), "of nobody knows which, where the environment was made anew"
    compiling.STAMP.write_text(json.dumps(compiling.digest()))
    assert not compiling.stale()
    monkeypatch.setattr(compiling, "digest", lambda: "of other sources")
    assert compiling.stale()


def test_a_link_to_a_library_that_is_gone_is_stale(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(compiling, "STAMP", tmp_path / "stamp.json")
    monkeypatch.setattr(compiling, "ROOT", tmp_path)
    compiling.STAMP.write_text(json.dumps(compiling.digest()))
    folder = tmp_path / "client/cogrip"
    folder.mkdir(parents=True)
    (folder / "core.cpython-311.so").touch()
    (folder / "loop.cpython-311.so").symlink_to("core.cpython-311.so")
    assert not compiling.stale()
    (folder / "core.cpython-311.so").unlink()
    assert compiling.stale()
    assert compiling.remove() == 1
    assert not list(folder.iterdir())


def test_a_library_lies_once_with_links_to_it(tmp_path: Path) -> None:
    library, other = tmp_path / "0.so", tmp_path / "1.so"
    library.write_text("code")
    other.write_text("more")
    (tmp_path / "a").mkdir()
    places = {"core": tmp_path / "core.so", "loop": tmp_path / "a/loop.so", "alone": tmp_path / "a/alone.so"}
    compiling.put({"core": library, "loop": library, "alone": other}, places)
    assert [places[name].is_symlink() for name in places] == [False, True, False]
    assert [places[name].read_text() for name in places] == ["code", "code", "more"]
    assert not os.path.isabs(os.readlink(places["loop"])), "a checkout can be moved"


def test_modules_share_libraries_in_which_each_is_found_by_its_name() -> None:
    names = [name for name, _ in compiling.sources()]
    libraries = compiling.shared_libraries(names)
    assert sorted([name for library in libraries for name in library]) == sorted(names)
    for library in libraries:
        last = [name.rpartition(".")[2] for name in library]
        assert len(set(last)) == len(last), "the importer looks for the last part of a name"
        assert len({name.startswith("cogrip.server.") for name in library}) == 1, "no client loads a server's"
    assert len(libraries) < 6
    assert compiling.shared_libraries(["cogrip.a.loop", "cogrip.b.loop", "cogrip.a.core"]) == [
        ["cogrip.a.core", "cogrip.a.loop"], ["cogrip.b.loop"],
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("made", "said"),
    [
        ([], "nothing was compiled; cogrip runs interpreted"),
        (["a.cpython-311.so"], "removed 1 compiled module; cogrip runs interpreted"),
        (["a.cp311.so", "a.cp312.so", "io/a.cp311.pyd"], "removed 2 compiled modules; cogrip runs interpreted"),
    ],
)
def test_what_is_removed_is_said_in_one_line(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str], made: list[str], said: str
) -> None:
    monkeypatch.setattr(compiling, "STAMP", tmp_path / "stamp.json")
    monkeypatch.setattr(compiling, "ROOT", tmp_path)
    (tmp_path / "server/cogrip/io").mkdir(parents=True)
    compiling.STAMP.write_text('"of other sources"')  # stale: what was compiled is counted nevertheless
    monkeypatch.setattr(dev, "setup", lambda: pytest.fail("removing needs no environment"))
    for name in made:
        (tmp_path / "server/cogrip" / name).touch()
    assert dev.compile_("--remove") == 0
    assert capsys.readouterr() == (f"{said}\n", "")
    assert not [each for each in tmp_path.rglob("*") if each.is_file()]


def test_the_constants_of_another_checkout_are_not_taken(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (other := tmp_path / "clock.py").write_text("DRIFT_PPM = 1\n")
    monkeypatch.setattr(compiling.importlib, "import_module", lambda name: SimpleNamespace(__file__=str(other)))
    with pytest.raises(ImportError, match=r"is imported from .*clock\.py and not from .*PYTHONPATH"):
        compiling.copy_sources(tmp_path / "copies")


def test_without_a_compiler_one_line_says_so(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(compiling, "has_compiler", lambda: False)
    monkeypatch.setattr(compiling, "remove", lambda: None)
    assert compiling.main([]) == 1
    assert re.fullmatch(r".*no C compiler.*runs without.*\n", capsys.readouterr().out)


SOURCE = '''"""Of é lines."""
MOST, SLACK_S, WIDE, NAME, OWN, SET, PI = 3, -0.5, 2**64, "name", 4, 5, 3

class Line:
    MOST = 7
    most = MOST

    def __init__(self): self.most = MOST

    def of(self, LENT, each=MOST):
        OWN = LENT
        inner = lambda x, y=MOST: x < MOST - OWN
        return [MOST, "é" and SLACK_S * self.MOST, f"{MOST}", WIDE, NAME, OWN, SET, MOST if inner(
            MOST) else 0]

    def change(self, given):
        global SET
        from math import pi as PI
        try:
            SET = given + PI
        except ValueError as MOST:
            return MOST
        match given:
            case [_, *SLACK_S]: return SLACK_S
            case {"own": OWN, **WIDE}: return OWN
'''


def test_functions_are_compiled_with_the_values_of_numeric_constants() -> None:
    module = ModuleType("line")
    exec(SOURCE, vars(module))
    values = compiling.constants(module)
    assert values == {"MOST": 3, "SLACK_S": -0.5, "OWN": 4, "SET": 5, "PI": 3}, "in 64 bits"
    wanted = SOURCE.replace("x < MOST", "x < (3)").replace("[MOST", "[(3)").replace("SLACK_S * ", "(-0.5) * ")
    wanted = wanted.replace(", MOST if", ", (3) if").replace("            MOST)", "            (3))")
    assert compiling.with_values(SOURCE, values) == wanted


def test_every_compiled_source_is_the_same_program_with_values() -> None:
    """Each differs from its source in names that were numbers, and every such number is the module's."""
    for name, source in compiling.sources():
        if source.suffix != ".py":
            continue
        module, text = importlib.import_module(name), source.read_text("utf-8")
        values = compiling.constants(module)
        made = compiling.with_values(text, values)
        for before, after in zip(text.split("\n"), made.split("\n"), strict=True):
            at = 0
            for piece in re.split(r"(\([-+\d.e]+\))", after):
                if not before.startswith(piece, at):
                    constant = re.compile(r"\w+").match(before, at)
                    assert constant, f"{source.name}: {after}"
                    assert ast.literal_eval(piece) == values[constant[0]]
                    piece = constant[0]
                at += len(piece)
            assert at == len(before)


@pytest.fixture
def installed(tmp_path: Path) -> Path:
    """Return a folder in which the files of a wheel lie, as pip unpacks one."""
    command = [sys.executable, "-P", "-m", "hatchling", "build", "-t", "wheel", "-d", str(tmp_path)]
    subprocess.run(command, cwd=ROOT, check=True, capture_output=True)
    (wheel,) = tmp_path.glob("*.whl")
    folder = tmp_path / "site-packages"
    zipfile.ZipFile(wheel).extractall(folder)
    return folder


def test_a_wheel_has_all_that_is_compiled_and_the_command(installed: Path) -> None:
    """It removes what was compiled from pip's list too, and leaves all else there."""
    for types in compiling.TYPES.rglob("*.p*"):
        assert (installed / "cogrip/machine/compiled" / types.relative_to(compiling.TYPES)).exists()
    (record,) = installed.glob("cogrip-*.dist-info/RECORD")
    before = record.read_text()
    (made := installed / "cogrip" / "protocol" / f"clock{compiling.SUFFIX}").touch()
    os.utime(made, (1, 1))  # older than its source: every other command refuses to run it
    record.write_text(f"{before}cogrip/protocol/{made.name},,\n")
    run = [sys.executable, "-P", "-m", "cogrip.cli", "compile", "--remove"]
    done = subprocess.run(
        run, env={**os.environ, "PYTHONPATH": str(installed)}, capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert "removed 1 compiled module; cogrip runs interpreted" in done.stdout
    assert not made.exists()
    assert record.read_text() == before


def test_what_is_compiled_is_entered_in_pip_s_list_of_files(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(compiling, "ROOT", tmp_path)
    monkeypatch.setattr(compiling, "INSTALLED", True)
    (record := tmp_path / "cogrip-1.0.dist-info" / "RECORD").parent.mkdir()
    record.write_text("cogrip/a.py,sha256=x,10\n'q,uoted',,\ncogrip/old.so,,\n")
    compiling.enter([tmp_path / "cogrip" / "a.so"])
    assert record.read_text() == "cogrip/a.py,sha256=x,10\n'q,uoted',,\ncogrip/a.so,,\n"


def test_in_a_checkout_the_command_names_the_other_one(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["compile"]) == 2
    assert "this is a checkout of cogrip; there it is `python3 dev.py compile`" in capsys.readouterr().err


@pytest.mark.long
@pytest.mark.lasts(600.0)
@pytest.mark.skipif(not compiling.has_compiler(), reason="no C compiler")
def test_recorded_sessions_and_laws_hold_in_the_compiled_form(tmp_path: Path) -> None:
    """Bit for bit: a recorded session is played again by the compiled form, from a recording of the interpreted one."""
    paths = []
    if form() == "interpreted":
        for part in compiling.PARTS:
            own = tmp_path / part / "cogrip"
            shutil.copytree(ROOT / part / "cogrip", own, ignore=shutil.ignore_patterns("__pycache__"))
            paths.append(str(tmp_path / part))
        shutil.copytree(compiling.TYPES, tmp_path / "compiled")
        (tmp_path / "build").mkdir()
        compiling.compile_all(tmp_path / "build", tmp_path)
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(paths)}
    is_compiled = "from cogrip.machine.compiled_files import form; assert form() == 'compiled'"
    subprocess.run([sys.executable, "-c", is_compiled], env=environment, check=True)
    subprocess.run([sys.executable, "-m", "pytest", *LAWS], cwd=ROOT, env=environment, check=True)
