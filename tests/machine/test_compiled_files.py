"""Choice of the form of a process: what was compiled of these sources or nothing, and all of it for as long as it runs."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from cogrip.machine import compiled_files
from cogrip.machine.compiled_files import CHOSEN, NEVER, OTHERS, SUFFIX, Fingerprint, checksum, fingerprint, read_built


def at(path: Path, seconds: int, text: str = "") -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    os.utime(path, (seconds, seconds))


@pytest.mark.parametrize("suffix", [".py", ".pyx", ".pxd"])
def test_any_change_of_a_source_shows(tmp_path: Path, suffix: str) -> None:
    source = tmp_path / "io" / f"ring{suffix}"
    at(source, 1000, "a")
    at(tmp_path / "rates.py", 1000, "bc")
    at(tmp_path / "__pycache__" / "rates.py", 5000, "no source")
    at(tmp_path / "notes.txt", 5000, "no source")
    before = fingerprint([tmp_path])
    assert before == Fingerprint(2, 3, 1000 * 10**9)
    at(source, 1001, "a")
    assert fingerprint([tmp_path]) == Fingerprint(2, 3, 1001 * 10**9)
    at(source, 900, "ab")
    assert fingerprint([tmp_path]) == Fingerprint(2, 4, 1000 * 10**9)
    source.unlink()
    assert fingerprint([tmp_path]) == Fingerprint(1, 2, 1000 * 10**9)


def test_contents_and_names_are_told_apart_wherever_and_whenever_they_were_put(tmp_path: Path) -> None:
    def of(*files: tuple[str, str], place: str = "a", seconds: int = 1000) -> int:
        folder = tmp_path / place / str(len(list(tmp_path.rglob("*"))))
        for name, text in files:
            at(folder / name, seconds, text)
        return checksum([folder])

    wanted = of(("io/ring.py", "a"), ("rates.pxd", "bc"))
    assert wanted == of(("rates.pxd", "bc"), ("io/ring.py", "a"), ("notes.txt", "x"), place="b", seconds=2000)
    for other in ("ab", "", "b"):
        assert of(("io/ring.py", other), ("rates.pxd", "bc")) != wanted
    assert of(("io/rung.py", "a"), ("rates.pxd", "bc")) != wanted
    assert of(("io/ring.py", "ab"), ("rates.pxd", "c")) != wanted
    assert of(("io/ring.py", "a")) != wanted


def test_what_is_not_whole_is_nothing(tmp_path: Path) -> None:
    told = tmp_path / "form.json"
    assert read_built(told) is None
    whole = {"folder": "1", "libraries": {"cogrip.a": f"0{SUFFIX}"}, "sources": [1, 2, 3], "checksum": 4}
    for text in ("", "[]", "{}", json.dumps(whole), json.dumps({**whole, "sources": [1]}), '{"folder": "1"}'):
        told.write_text(text)
        assert read_built(told) is None, text
    (tmp_path / "1").mkdir()
    (library := tmp_path / "1" / f"0{SUFFIX}").touch()
    told.write_text(json.dumps(whole))
    modules = read_built(told) or pytest.fail("it is whole")
    assert (modules.sources, modules.checksum) == (Fingerprint(1, 2, 3), 4)
    found = modules.find_spec("cogrip.a", None)
    assert found is not None
    assert found.origin == str(library)
    assert modules.find_spec("cogrip.b", None) is None


FORM = "from cogrip.protocol.line import energy_sums; from cogrip.machine.compiled_files import form; print(form())"


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    """Return a checkout of two packages, in which something was built."""
    for part in ("machine", "protocol"):
        own = Path(compiled_files.part_folders()[f"cogrip.{part}"])
        for source in own.rglob("*.py"):
            at(tmp_path / part / "cogrip" / part / source.relative_to(own), 1000, source.read_text())
    for part in ("devices", "client", "server"):
        at(tmp_path / part / "cogrip" / part / "__init__.py", 1000)
    at(tmp_path / "compiled" / "cogrip" / "protocol" / "line" / "energy_sums.pxd", 1000)
    return tmp_path


def build(checkout: Path, generation: str = "1") -> None:
    """Put into a checkout as what was compiled a library that Python cannot load: loading it is the sign that it was chosen."""
    at(checkout / ".built" / generation / f"0{SUFFIX}", 1000, "no library")
    code = "from cogrip.machine.compiled_files import *; print(checksum(), *fingerprint())"
    crc, *sources = map(int, ran(checkout, code).stdout.split())
    told = {
        "folder": generation,
        "libraries": {"cogrip.protocol.line.energy_sums": f"0{SUFFIX}"},
        "sources": sources,
        "checksum": crc,
    }
    (checkout / ".built" / compiled_files.NAME).write_text(json.dumps(told))


def ran(checkout: Path, code: str, form: str = "") -> subprocess.CompletedProcess[str]:
    paths = os.pathsep.join(str(checkout / part) for part in ("machine", "protocol"))
    environment = {**os.environ, "PYTHONPATH": paths, CHOSEN: form}
    return subprocess.run(
        [sys.executable, "-P", "-c", code], capture_output=True, text=True, check=False, env=environment
    )


def test_what_was_compiled_of_these_sources_is_chosen_and_of_others_not(checkout: Path) -> None:
    assert ran(checkout, FORM).stdout == "interpreted\n"
    build(checkout)
    assert f"0{SUFFIX}" in (found := ran(checkout, FORM)).stderr, "it is loaded"
    assert found.stdout == ""
    assert ran(checkout, FORM, "interpreted").stdout == "interpreted\n"
    at(changed := checkout / "client" / "cogrip" / "client" / "__init__.py", 2000)
    assert f"0{SUFFIX}" in ran(checkout, FORM).stderr, "its contents are the same"
    at(changed, 1000, "RATE_HZ = 1024.0")
    assert ran(checkout, FORM).stdout == "interpreted\n", (
        "a constant of an interpreted module may stand in a compiled one"
    )


def test_a_process_has_the_form_of_the_one_that_started_it(checkout: Path) -> None:
    """Whatever is changed or compiled meanwhile: what they send each other is of one form."""
    child = f"import subprocess, sys; subprocess.run([sys.executable, '-P', '-c', {FORM!r}])"
    parent = "import cogrip.machine; print(form := cogrip.machine.compiled_files.form(), flush=True); "
    change = (
        f"import pathlib; pathlib.Path({str(checkout / 'client/cogrip/client/__init__.py')!r}).write_text('A = 1'); "
    )
    build(checkout)
    found = ran(checkout, parent + change + child)
    assert found.stdout == "compiled\n"
    assert "0" + SUFFIX in found.stderr, "the child loads it as well"
    assert ran(checkout, parent + child).stdout == "interpreted\ninterpreted\n"


def test_a_checkout_that_was_moved_keeps_what_it_has(checkout: Path) -> None:
    build(checkout)
    moved = checkout.rename(checkout.with_name("moved"))
    assert ran(moved, "import cogrip.machine; print(cogrip.machine.compiled_files.form())").stdout == "compiled\n"


def test_why_a_process_runs_interpreted_is_said(checkout: Path) -> None:
    why = "from cogrip.machine.compiled_files import why_interpreted; print(why_interpreted())"
    assert ran(checkout, why).stdout == f"{NEVER}\n"
    build(checkout)
    assert ran(checkout, why).stdout == "\n"
    at(checkout / "protocol" / "cogrip" / "protocol" / "new.py", 1000)
    assert ran(checkout, why).stdout == f"{OTHERS}\n"
