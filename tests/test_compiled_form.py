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
from functools import partial
from pathlib import Path
from types import ModuleType, SimpleNamespace

import compiling
import dev
import pytest

from cogrip.cli.main import main
from cogrip.machine import compiled_files
from cogrip.machine.compiled_files import form

ROOT = Path(__file__).parent.parent
LAWS = (
    "tests/protocol/test_line.py", "tests/protocol/test_energy_sums.py", "tests/protocol/test_concealment.py",
    "tests/protocol/test_jitter_buffer.py", "tests/protocol/test_clock.py", "tests/protocol/test_button_edges.py",
    "tests/machine/test_ring.py", "tests/machine/test_histogram.py", "tests/server/test_grip_world.py",
    "tests/server/test_seat_limits.py", "tests/server/test_rate_limit.py", "tests/server/test_dtls_channel.py",
    "tests/server/test_recorded_server_plays_again.py", "tests/results/test_recorded_sessions.py",
    "tests/protocol/test_decimation.py", "tests/protocol/test_wave_filter.py", "tests/client",
    "tests/sim/test_schemes.py", "tests/sim/test_partner_sessions.py", "tests/sim/test_local_sessions.py",
    "tests/devices/test_simulated_hands.py", "tests/devices/test_simulated_plants.py", "tests/devices/test_plausibility.py",
)  # fmt: skip


def test_every_type_file_has_its_module() -> None:
    found = compiling.sources()
    assert all(source.exists() for _, source in found)
    assert (compiled_files.PARTS, compiled_files.LINUX_ONLY) == (compiling.PARTS, compiling.LINUX_ONLY)
    assert compiled_files.built_folder() == compiling.BUILT
    assert compiled_files.part_folders() == {
        f"cogrip.{part}": compiling.folder_of(part) / part for part in compiling.PARTS
    }
    chosen = compiled_files.chosen()
    for name in (name for name, source in found if source.suffix == ".py"):  # others are there only compiled
        module = importlib.import_module(name)
        assert str(module.__file__).endswith(".py") is (chosen is None), "of the form that is said"


def _typed_classes() -> dict[str, tuple[str, set[str]]]:
    """Return class -> (base, attributes that its type file keeps from Python)."""
    found: dict[str, tuple[str, set[str]]] = {}
    for types in compiling.TYPES.rglob("*.pxd"):
        for name, base, body in re.findall(
            r"^cdef class (\w+)(?:\((\w+)\))?:\n((?:    .*\n|\n)*)", types.read_text(), re.MULTILINE
        ):
            kept = re.findall(r"^    cdef (?!public |readonly )[^(\n]*?(\w+)$", body, re.MULTILINE)
            found[name] = base, set(kept)
    return found


def test_no_interpreted_class_needs_what_a_typed_base_keeps_from_it() -> None:
    """A class without types of its own that is derived from one with types reaches the public attributes alone."""
    typed, derived = _typed_classes(), {}
    for part in compiling.PARTS:
        for path in compiling.folder_of(part).rglob("*.py"):
            for node in ast.parse(path.read_text(encoding="utf-8")).body:
                if isinstance(node, ast.ClassDef) and node.name not in typed:
                    derived[node.name] = node
    assert typed

    def kept_from(name: str) -> set[str]:
        if name in typed:
            base, kept = typed[name]
            return kept | kept_from(base) if base else kept
        bases = [ast.unparse(base).split(".")[-1] for base in derived[name].bases] if name in derived else []
        return set().union(*(kept_from(base) for base in bases if base != name))

    used = {
        name: {
            each.attr
            for each in ast.walk(node)
            if isinstance(each, ast.Attribute) and ast.unparse(each.value) == "self"
        }
        for name, node in derived.items()
    }
    assert not {name: attributes & kept_from(name) for name, attributes in used.items() if attributes & kept_from(name)}


def test_an_installation_by_pip_is_compiled_by_its_own_command(monkeypatch: pytest.MonkeyPatch) -> None:
    assert compiled_files.compile_command() == "python3 dev.py compile"
    monkeypatch.setitem(sys.modules, "cogrip.cli.compiling", ModuleType("cogrip.cli.compiling"))
    sys.modules["cogrip.cli.compiling"].__spec__ = SimpleNamespace()  # type: ignore[assignment]
    assert compiled_files.compile_command() == "cogrip compile"


def test_libraries_are_put_beside_the_ones_before_and_told_at_one_blow(tmp_path: Path) -> None:
    """A process that has the ones before imports from them to its end."""
    built, sources, checksum = tmp_path / "built", [1, 2, 3], 4
    generations = []
    for number in range(3):
        libraries = {name: tmp_path / str(number) / name for name in ("0.so", "1.so")}
        for name, library in libraries.items():
            library.parent.mkdir(exist_ok=True)
            library.write_text(f"{name} {number}")
        compiling.put(
            {"core": libraries["0.so"], "loop": libraries["0.so"], "alone": libraries["1.so"]}, built, sources, checksum
        )
        modules = compiled_files.read_built(built / compiled_files.NAME) or pytest.fail("not whole")
        assert (modules.sources, modules.checksum) == ((1, 2, 3), 4)
        assert modules.libraries["core"] == modules.libraries["loop"] != modules.libraries["alone"]
        assert (modules.folder / modules.libraries["alone"]).read_text() == f"1.so {number}"
        generations.append(modules.folder)
    assert [folder.exists() for folder in generations] == [False, True, True]
    assert len(list(built.iterdir())) == 3
    assert compiling.remove(built) == 3
    assert not built.exists()


def test_a_second_process_leaves_the_first_one_to_compile(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    fcntl = pytest.importorskip("fcntl")
    monkeypatch.setattr(compiling, "BUILT", tmp_path)
    with (tmp_path / "lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        assert compiling.main(["--background", str(os.getppid())]) == 0
    assert [each.name for each in tmp_path.iterdir()] == ["lock"]


def test_set_up_compiles_in_the_background_but_where_it_is_told_not_to(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(dev, "prepare", lambda: 0)
    monkeypatch.setattr(compiling, "in_background", lambda: True)
    assert dev.setup("--no-compile") == 0
    assert capsys.readouterr().err == ""
    assert dev.setup() == 0
    assert re.fullmatch(r"dev\.py: compiles in the background.*--remove.*\n", capsys.readouterr().err)


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
    ("modules", "said"),
    [
        ((), "nothing was compiled; cogrip runs interpreted"),
        (("core",), "removed 1 compiled module; cogrip runs interpreted"),
        (("core", "loop"), "removed 2 compiled modules; cogrip runs interpreted"),
    ],
)
def test_what_is_removed_is_said_in_one_line(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str], modules: list[str], said: str
) -> None:
    (library := tmp_path / "0.so").touch()
    if modules:
        compiling.put(dict.fromkeys(modules, library), tmp_path / "built", [1, 2, 3], 4)
    monkeypatch.setattr(compiling, "remove", partial(compiling.remove, tmp_path / "built"))
    monkeypatch.setattr(dev, "prepare", lambda: pytest.fail("removing needs no environment"))
    monkeypatch.setenv(compiled_files.CHOSEN, "")
    assert dev.compile_("--remove") == 0
    assert capsys.readouterr() == (f"{said}\n", "")
    assert not (tmp_path / "built").exists()


def test_the_constants_of_another_checkout_are_not_taken(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (other := tmp_path / "clock.py").write_text("DRIFT_PPM = 1\n")
    monkeypatch.setattr(compiling.importlib, "import_module", lambda name: SimpleNamespace(__file__=str(other)))
    with pytest.raises(ImportError, match=r"is imported from .*clock\.py and not from .*PYTHONPATH"):
        compiling.copy_sources(tmp_path / "copies")


def test_without_a_compiler_one_line_says_so(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(compiling, "has_compiler", lambda: False)
    monkeypatch.setenv(compiled_files.CHOSEN, "")
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


def test_c_functions_alone_are_compiled_for_speed() -> None:
    """Functions that Python calls are told apart where they are declared and where they are defined; calls are left alone."""
    plain = (
        "PyObject *__pyx_pw_3mod_5Line_1of(PyObject *__pyx_v_self, PyObject *unused); /*proto*/\n",
        "PyObject *__pyx_getprop_3mod_4Line_length(PyObject *o, CYTHON_UNUSED void *x) {\n",
        "CYTHON_SMALL_CODE int __pyx_pymod_exec_mod(PyObject* module); /*proto*/\n",
    )
    other = (
        "static double __pyx_f_3mod_4Line_of(struct __pyx_obj_Line *__pyx_v_self, int __pyx_skip_dispatch); /* proto*/\n"
        'static PyMethodDef __pyx_mdef_1of = {"of", (PyCFunction)__pyx_pw_3mod_5Line_1of, METH_NOARGS, 0};\n'
        "  __pyx_r = __pyx_pf_3mod_4Line_of(((struct __pyx_obj_Line *)__pyx_v_self));\n"
    )
    made = compiling.with_plain_wrappers("".join(f"static {each}" for each in plain) + other)
    assert made == "".join(f"static {compiling.PLAIN} {each}" for each in plain) + other
    assert all(f'"{flag[2:]}"' in compiling.PLAIN for flag in ("-ffp-contract=off", "-fwrapv", "-fno-strict-aliasing"))


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
    (made := installed / "cogrip" / "machine" / "compiled" / "built" / "1" / "0.so").parent.mkdir(parents=True)
    made.touch()
    told = made.parents[1] / compiled_files.NAME
    told.write_text(
        json.dumps({"folder": "1", "libraries": {"cogrip.protocol.clock": "0.so"}, "sources": [1, 2, 3], "checksum": 4})
    )
    record.write_text(f"{before}cogrip/machine/compiled/built/1/0.so,,\n")
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
    built = "cogrip/machine/compiled/built"
    record.write_text(f"cogrip/a.py,sha256=x,10\n'q,uoted',,\n{built}/old/0.so,,\n")
    compiling.enter([tmp_path / built / "new" / "0.so"])
    assert record.read_text() == f"cogrip/a.py,sha256=x,10\n'q,uoted',,\n{built}/new/0.so,,\n"


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
        compiling.compile_all(tmp_path / "build", tmp_path / ".built")
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(paths), compiled_files.CHOSEN: ""}
    is_compiled = "from cogrip.machine.compiled_files import form; assert form() == 'compiled'"
    subprocess.run([sys.executable, "-c", is_compiled], env=environment, check=True)
    subprocess.run([sys.executable, "-m", "pytest", *LAWS], cwd=ROOT, env=environment, check=True)
