"""Foreign scenes are tried in a child process first: what would take this one's memory or time is refused in a line."""

import os
import resource
import signal
import threading
import time
from functools import partial
from mmap import mmap
from pathlib import Path

import pytest

from cogrip.machine import trial
from cogrip.machine.server_platform import FORKS
from cogrip.machine.trial import TrialLimitError, tried
from cogrip.server.worlds.scenes import scene_file
from cogrip.server.worlds.scenes.scene_file import Held, make_scene
from cogrip.server.worlds.scenes.scene_text import SceneError, scene_of

from tests.extent import long
from tests.server.scene_worlds import SCENES, SHIPPED

SEATS = [Held("", "left", ""), Held("", "right", "")]
STEP = 1 / 512
BOX = '<body name="o"><freejoint/><geom type="box" size=".02 .02 .02" mass=".2"/></body>'
LIMIT_S = 60.0


@pytest.fixture(autouse=True)
def _in_a_child(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(scene_file, "tried", tried)


pytestmark = pytest.mark.skipif(not FORKS, reason="elsewhere the system limits no memory")


def scene(world: str = "", rest: str = "") -> str:
    return f"<mujoco><worldbody>{BOX}{world}</worldbody>{rest}</mujoco>"


def asset(element: str) -> str:
    return scene("", f"<asset>{element}</asset>")


CROWD = "".join(f'<body pos="{i % 17 * 1e-3} 0 0"><freejoint/><geom size=".1"/></body>' for i in range(1500))
OVER_IT = '<body pos="0 0 .03"><freejoint/><geom type="box" size=".02 .02 .02"/></body>'
BALL = '<geom size=".01"/>'
BOMBS = {  # a few bytes each
    "texture": asset('<texture name="t" type="2d" builtin="checker" width="20000" height="20000"/>'),
    "height field": asset('<hfield name="h" nrow="20000" ncol="20000" size="1 1 1 .1"/>'),
    "numbers of a user": scene(rest='<size nuser_body="1000000000"/>'),
    "keys": scene(rest='<size nkey="2000000000"/>'),
    "sensor": scene(rest='<sensor><user dim="500000000"/></sensor>'),
    "memory": scene(rest='<size memory="100G"/>'),
    "mesh": asset('<mesh name="m" builtin="supertorus" params="20000 .5 1 1"/>'),
    "copies": scene(f'<replicate count="+200000" offset=".1 0 0">{BALL}</replicate>'),
    "copies of copies": scene(
        f'<replicate count="&#43;400" offset=".1 0 0"><replicate count="+400" offset="0 .1 0">{BALL}</replicate></replicate>'
    ),
    "cloth": scene('<flexcomp name="f" type="square" count="3000 3000 1" spacing=".01 .01 .01" dim="2"/>'),
    "crowd": scene(CROWD),
    "solver": scene(OVER_IT, '<option ls_iterations="2147483647" ls_tolerance="0"/>'),
    "collisions": scene(OVER_IT, '<option ccd_iterations="2147483647" ccd_tolerance="1e-300"/>'),
    "starting points": scene(rest='<option sdf_initpoints="2147483647"/>'),
}


@pytest.mark.parametrize("name", [long(name) if name == "copies" else name for name in BOMBS])
def test_a_small_text_takes_neither_memory_nor_processor(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(trial, "PROCESSOR_S", 1)
    monkeypatch.setattr(scene_file, "_load", partial(in_a_child, os.getpid(), scene_file._load))
    with pytest.raises(SceneError, match=r"^x\.xml: .*(make it smaller|leave it out)") as caught:
        make_scene(BOMBS[name], SEATS, STEP, "x.xml")
    assert "\n" not in str(caught.value)
    if name == "texture":  # nothing is kept of it
        with pytest.raises(SceneError):
            make_scene(BOMBS[name], SEATS, STEP, "x.xml")


def in_a_child(parent: int, load: object, *arguments: object) -> scene_file.Scene:
    assert os.getpid() != parent, "it is loaded here"
    return load(*arguments)  # type: ignore[operator, no-any-return]


@pytest.mark.parametrize(
    ("count", "refused"), [(scene_file.MOST_ITERATIONS, False), (scene_file.MOST_ITERATIONS + 1, True)]
)
def test_a_solver_has_so_many_iterations_at_most(count: int, refused: bool) -> None:
    text = scene(rest=f'<option iterations="{count}"/>')
    if refused:
        with pytest.raises(SceneError, match=r"option iterations = 1001 is more than 1000; leave it out$"):
            make_scene(text, SEATS, STEP)
    else:
        assert make_scene(text, SEATS, STEP).model.opt.iterations == count


@pytest.mark.parametrize("name", SHIPPED)
def test_a_scene_is_tried_once_for_each_text_and_is_what_it_was(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(scene_file, "_tried", set())
    trials = []
    monkeypatch.setattr(scene_file, "tried", lambda trial: trials.append(trial) or tried(trial))
    text = (SCENES / f"{name}.xml").read_text()
    first, second = make_scene(text, SEATS, STEP), make_scene(text, SEATS, STEP)
    assert len(trials) == 1
    assert first.digest == second.digest
    make_scene(text + " ", SEATS, STEP)
    make_scene(text, SEATS, STEP / 2)
    make_scene(text, SEATS[:1], STEP)
    assert len(trials) == 4


def test_whatever_mujoco_raises_is_a_line(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object) -> None:
        raise RuntimeError("Caught an unknown\nexception!")

    monkeypatch.setattr(scene_file, "_compile", fail)
    with pytest.raises(SceneError, match=r"^scene: does not load: Caught an unknown exception!; make it smaller"):
        scene_file._load(scene_of(scene(), "scene"), SEATS, STEP, "", (), "")


# The child process -----------------------------------------------------------------------------------------------------


def spin() -> str:
    while True:
        pass


def hoard() -> str:
    kept = []
    while True:
        kept.append(mmap(-1, 2**24))  # address space counts: pages that nobody touches take no time


BEFORE = {  # Each entry is what a trial does, and what is said of it.
    "spin": (spin, "takes more than 1 s of the processor"),
    "hoard": (hoard, "takes more than 1024 MB of memory, or ends the process that loads it"),
    "abort": (os.abort, "ends the process that loads it"),
    "exit": (partial(os._exit, 0), "ends the process that loads it"),
    "wait": (signal.pause, r"has taken more than 0\.1 s"),
}


@pytest.mark.parametrize("name", BEFORE)
@pytest.mark.parametrize("forks", [True, False])
def test_a_trial_without_an_answer_says_which_limit_it_met(
    name: str, forks: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    if not forks and name in ("spin", "hoard"):
        pytest.skip("the limits of a started interpreter are those of the module, as it is")
    monkeypatch.setattr(trial, "FORKS", forks)
    monkeypatch.setattr(trial, "PROCESSOR_S", 1 if name == "spin" else 60)
    monkeypatch.setattr(trial, "CLOCK_S", 0.1 if name == "wait" else LIMIT_S)
    act, words = BEFORE[name]
    with pytest.raises(TrialLimitError, match=words):
        tried(act)


@pytest.mark.parametrize("forks", [True, False])
@pytest.mark.parametrize("text", ["", "a: does not load", "ä" * 40_000])
def test_an_answer_comes_through(text: str, forks: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(trial, "FORKS", forks)
    given = tried(partial(str, text))
    assert text.startswith(given)
    assert len(given.encode()) == min(len(text.encode()), trial.MOST_ANSWER_BYTES - 2)


def test_a_scene_is_tried_where_nothing_forks(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(trial, "FORKS", False)
    monkeypatch.setattr(scene_file, "_tried", set())
    assert make_scene(scene(), SEATS, STEP).object > 0
    with pytest.raises(SceneError, match="does not load: "):
        make_scene(scene("<bad/>"), SEATS, STEP)


@pytest.mark.parametrize("reaped", [False, True])
def test_a_trial_beside_threads_and_without_children_to_wait_for(reaped: bool) -> None:
    over = threading.Event()
    busy = [threading.Thread(target=over.wait) for _ in range(4)]
    before = signal.signal(signal.SIGCHLD, signal.SIG_IGN) if reaped else signal.getsignal(signal.SIGCHLD)
    try:
        for each in busy:
            each.start()
        assert [tried(partial(str, "ok")) for _ in range(5)] == ["ok"] * 5
    finally:
        signal.signal(signal.SIGCHLD, before)
        over.set()
        for each in busy:
            each.join()


def test_its_standard_files_and_its_parents_signals_are_not_the_childs(capfd: pytest.CaptureFixture[str]) -> None:
    def shout() -> str:
        os.write(1, b"out")
        os.write(2, b"err")
        return f"{signal.getsignal(signal.SIGTERM) == signal.SIG_DFL} {time.monotonic() > 0}"

    before = signal.signal(signal.SIGTERM, lambda number, frame: None)
    try:
        assert tried(shout) == "True True"
    finally:
        signal.signal(signal.SIGTERM, before)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("name", ["AS", "CPU"])
def test_a_limit_that_holds_already_stays(name: str) -> None:
    """A service may have less than a trial is let have."""

    def under_less() -> str:
        resource.setrlimit(kind, (most, most))
        return tried(partial(str, "ok"))

    kind = getattr(resource, f"RLIMIT_{name}")
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    most = {"AS": pages * resource.getpagesize() + 2**28, "CPU": 5}[name]  # a fork's processor time begins anew
    assert tried(under_less) == "ok"


def test_names_of_a_scene_move_no_cursor() -> None:
    text = scene('<body name="a&#155;2J"><freejoint/><geom size=".1" material="b&#155;2J"/></body>')
    with pytest.raises(SceneError) as caught:
        make_scene(text, SEATS, STEP)
    assert str(caught.value).isprintable()
    with pytest.raises(SceneError) as caught:
        make_scene(text.replace(' material="b&#155;2J"', ""), [Held("none", "left", "")], STEP)
    assert str(caught.value).isprintable()
