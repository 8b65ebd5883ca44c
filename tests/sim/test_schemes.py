"""Every coupling scheme and every kind of object has its row in each table that is indexed by it, and is named nowhere else."""

import ast
import re
from collections.abc import Set
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pytest

from cogrip.analysis.advice.advice import INSTEAD, TOO_MUCH
from cogrip.analysis.linear.lifted_model import KINDS as BLOCKS
from cogrip.analysis.linear.linear_session import FORMS, Form, form_of, form_overrides, linear_session
from cogrip.cli.settings.shipped_settings import shipped_scene
from cogrip.client.coupling import schemes as client_schemes
from cogrip.experiments.methods.method import METHODS
from cogrip.protocol.settings.coupling_kinds import COUPLING_KINDS, CouplingKind, Kind
from cogrip.protocol.settings.object_kinds import KINDS as OBJECT_KINDS
from cogrip.protocol.settings.object_kinds import ObjectKind
from cogrip.protocol.settings.room import resolve, seat_settings
from cogrip.protocol.settings.table import SettingsError
from cogrip.protocol.wire.messages import FRAMES, Frame
from cogrip.protocol.wire.session import FOR_CLIENTS
from cogrip.server import schemes as server_schemes
from cogrip.server.worlds.grip import GripWorld
from cogrip.server.worlds.push import PushWorld
from cogrip.server.worlds.registry import WORLDS, world_class_of

ROOT = Path(__file__).parents[2]
KINDS = get_args(Kind)


def test_every_scheme_and_every_form_of_linear_model_has_its_rows() -> None:
    for table in (COUPLING_KINDS, client_schemes.SCHEMES, server_schemes.SCHEMES):
        assert tuple(table) == KINDS
    assert set(client_schemes.LOCAL_CONTACTS) == {kind for kind, traits in OBJECT_KINDS.items() if traits.local}
    assert {method.overrides["coupling.kind"] for method in METHODS.values()} == set(KINDS)
    assert tuple(FORMS) == tuple(BLOCKS) == tuple(TOO_MUCH) == tuple(INSTEAD) == get_args(Form)


@pytest.mark.parametrize("form", get_args(Form))
def test_the_settings_of_a_form_ask_for_it(form: Form) -> None:
    settings = resolve({}, form_overrides(form))
    assert form_of(seat_settings(settings, 0).coupling) == form
    assert (FORMS[form].damper_key == "damping_nspm") == (BLOCKS[form].width == 2) == (not FORMS[form].waves)
    assert hasattr(linear_session(settings).people[0], FORMS[form].damper_key)


NAMES = {*KINDS, *OBJECT_KINDS}
QUOTED = re.compile(rf"""(["'])({"|".join({*NAMES, *METHODS})})\1""")  # A module without a match need not be parsed.
PACKAGES = (
    "machine", "protocol", "devices", "client", "server", "sim", "results", "analysis", "experiments", "view", "api", "cli",
)  # fmt: skip
OTHERS = {
    "protocol/cogrip/protocol/settings/coupling_kinds.py": "the names themselves",
    "experiments/cogrip/experiments/methods/method.py": "a section of settings is called coupling",
    "analysis/cogrip/analysis/figures/paper_regions.py": "the forms of linear model that the paper has figures of",
}
"""Modules in which such a comparison or list is of something else, and of what."""


def is_name(node: ast.AST | None, names: Set[str]) -> bool:
    return isinstance(node, ast.Constant) and node.value in names


def names_in(node: ast.AST, names: Set[str]) -> bool:
    """Return whether this is one of the names, or a tuple, list or set with one of them."""
    return is_name(node, names) or (
        isinstance(node, ast.Tuple | ast.List | ast.Set) and any(is_name(each, names) for each in node.elts)
    )


def names_a_kind(node: ast.AST) -> bool:
    """Return whether this decides by the name of a kind: a comparison, a case, a table on the spot, or a list by hand."""
    match node:
        case ast.Compare(left=left, comparators=others):
            return any(names_in(side, NAMES) for side in (left, *others))
        case ast.MatchValue(value=value):
            return is_name(value, NAMES)
        case ast.Subscript(value=ast.Dict(keys=keys)) | ast.Attribute(value=ast.Dict(keys=keys), attr="get"):
            return any(is_name(key, NAMES) for key in keys)
        case ast.Tuple(elts=[_, _, *_] as each) | ast.List(elts=[_, _, *_] as each) | ast.Set(elts=[_, _, *_] as each):
            return all(is_name(name, {*NAMES, *METHODS}) for name in each)
    return False


@pytest.mark.parametrize(
    ("source", "found"),
    [
        ('self.local_contact == "faces"', True), ('row.get("local") != "scene"', True), ('"wall" == kind', True),
        ('dig(summary, "object", "kind") != "scene"', True), ('(key, value) != ("coupling.kind", "local")', True),
        ('kind in ("wave", "local")', True), ('kind not in {"cube"}', True), ('{"wave": 1}.get(kind, 2)', True),
        ('{"wave": 1}[kind]', True), ('OURS = ("wave", "tuned")', True), ("match kind:\n case 'partner': pass", True),
        ('kind == "other"', False), ('dig(summary, "object", "kind") != other', False), ('f("wave")', False),
        ('yield "coupling.kind", "wave"', False), ('TABLE = {"wave": 1, "local": 2}', False), ('row["local"] == x', False),
    ],
)  # fmt: skip
def test_a_decision_by_the_name_of_a_kind_is_found(source: str, found: bool) -> None:
    assert any(map(names_a_kind, ast.walk(ast.parse(source)))) == found


def test_a_kind_is_named_in_tables_alone() -> None:
    found = {
        f"{path.relative_to(ROOT)}: {ast.unparse(node)}"
        for package in PACKAGES
        for path in (ROOT / package).rglob("*.py")
        if QUOTED.search(source := path.read_text(encoding="utf-8")) and path.relative_to(ROOT).as_posix() not in OTHERS
        for node in ast.walk(ast.parse(source))
        if names_a_kind(node)
    }
    assert not found, "its row says what it is"


def test_every_kind_speaks_a_message_that_clients_and_servers_take() -> None:
    for row in COUPLING_KINDS.values():
        assert FRAMES[row.frame] in FOR_CLIENTS
    assert tuple(FRAMES.values()) == get_args(Frame)


@pytest.mark.parametrize("kind", OBJECT_KINDS)
def test_every_kind_of_object_has_a_world(kind: str) -> None:
    scene = {"axes": 3, "file": str(shipped_scene("wall.xml"))} if kind == "scene" else {}
    settings = resolve({"object": {"kind": kind, **scene}})
    seat = seat_settings(settings, 0)
    assert server_schemes.make_room_world(settings, [seat]).axes == seat.object.axes
    assert (kind in WORLDS) == (kind != "scene")


def test_a_plain_kind_has_no_world_of_its_own() -> None:
    """Worlds of other schemes go by the traits alone, and would step another thing than the world for waves does."""
    for kind, traits in OBJECT_KINDS.items():
        if traits.plain:
            assert world_class_of(kind).make is (GripWorld if traits.held else PushWorld), "else it is not plain"


class Rope(GripWorld):
    """A world of its own."""


@pytest.mark.parametrize("kind", KINDS)
def test_a_kind_with_a_world_of_its_own_is_refused_by_schemes_that_have_no_such_world(
    kind: Kind, monkeypatch: pytest.MonkeyPatch
) -> None:
    traits = ObjectKind(plain=False, one_sided=False, fixed=False, local=True, scene=False)
    monkeypatch.setitem(OBJECT_KINDS, "rope", traits)
    monkeypatch.setitem(WORLDS, "rope", f"{__name__}:Rope")
    table: dict[str, Any] = {"object": {"kind": "rope"}, "coupling": {"kind": kind}}
    if COUPLING_KINDS[kind].any_world:
        settings = resolve(table)
        assert type(server_schemes.make_room_world(settings, [seat_settings(settings, 0)])) is Rope
        table["coupling"]["server_step"] = "paper"
    with pytest.raises(SettingsError, match=r'coupling\.(kind = "wave"|server_step = "passive")$'):
        resolve(table)


def test_whoever_adds_a_kind_decides_each_trait() -> None:
    assert not ObjectKind._field_defaults
    assert not CouplingKind._field_defaults


@pytest.mark.parametrize("kind", KINDS)
def test_every_scheme_has_scenes_of_its_own(kind: Kind) -> None:
    one = COUPLING_KINDS[kind].one_object
    scene = {"kind": "scene", "axes": 3, "file": str(shipped_scene("lift.xml" if one else "wall.xml"))}
    settings = resolve({"object": scene, "coupling": {"kind": kind}})
    world = server_schemes.make_room_world(settings, [seat_settings(settings, 0)])
    waves = COUPLING_KINDS[kind].waves
    row = (0.0,) * world.axes * world.inputs_per_axis
    world.join(0, np.zeros(3))
    assert len(world.advance([row])[0]) == (27 if one else 3 * (1 if waves else 2))
    assert (world.accounts.limiter() is not None) == waves
