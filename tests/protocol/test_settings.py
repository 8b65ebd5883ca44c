"""The one schema: what is refused, with which words, on both sides of every bound; overrides; what the seats share."""

from collections import Counter
from collections.abc import Iterator
from math import pi
from pathlib import Path
from typing import Any

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec import inspect

from cogrip.protocol.settings import room as schema
from cogrip.protocol.settings.delays import line_delay
from cogrip.protocol.settings.digest import digest
from cogrip.protocol.settings.link_profile import LinkProfile
from cogrip.protocol.settings.rates import Rates
from cogrip.protocol.settings.room import resolve, seat_settings
from cogrip.protocol.settings.seat import SeatSettings
from cogrip.protocol.settings.sections import Playout, Settings
from cogrip.protocol.settings.table import SettingsError, parse_override
from cogrip.protocol.settings.types import MOST_RENDERED_NPM


def refused(table: dict[str, Any], overrides: dict[str, Any] | None = None) -> str:
    with pytest.raises(SettingsError) as caught:
        resolve(table, overrides)
    return str(caught.value)


def nested(path: str, value: Any) -> dict[str, Any]:
    """{"a": {"b": value}} for a.b; users is a list of one."""
    key, _, rest = path.partition(".")
    if key == "users" and rest:
        return {"users": [nested(rest.partition(".")[2], value)]}
    return {key: nested(rest, value) if rest else value}


def leaves(kind: inspect.Type, path: str = "") -> Iterator[tuple[str, inspect.Type]]:
    """(path, type) of every setting; of a union, of each of its types."""
    match kind:
        case inspect.StructType(fields=fields):
            for field in fields:
                yield from leaves(field.type, f"{path}.{field.name}".lstrip("."))
        case inspect.VarTupleType(item_type=inspect.StructType(cls=schema.User) as user):
            yield from leaves(user, f"{path}.0")
        case inspect.UnionType(types=types):
            for each in types:
                yield from leaves(each, path)
        case _:
            yield path, kind


LEAVES = list(leaves(inspect.type_info(Settings)))
NUMBERS = [(path, kind) for path, kind in LEAVES if isinstance(kind, inspect.IntType | inspect.FloatType)]


def bounds() -> Iterator[tuple[str, float, bool]]:
    """(path, value, allowed) at and just beyond every bound of every number."""
    for path, kind in NUMBERS:
        step = 1 if isinstance(kind, inspect.IntType) else 1e-9
        if kind.ge is not None:
            yield from ((path, kind.ge, True), (path, kind.ge - step, False))
        if kind.gt is not None:
            yield from ((path, kind.gt, False), (path, kind.gt + step, True))
        if kind.le is not None:
            yield from ((path, kind.le, True), (path, kind.le + max(step, abs(kind.le) * 1e-9 * (step < 1)), False))


BOUNDS = list(bounds())


def test_every_number_has_a_bound_on_both_sides() -> None:
    beyond = Counter(path for path, _, allowed in BOUNDS if not allowed)
    assert beyond == dict.fromkeys([path for path, _ in NUMBERS], 2)


@pytest.mark.parametrize(("path", "value", "allowed"), BOUNDS)
def test_both_sides_of_every_bound(path: str, value: float, allowed: bool) -> None:
    try:
        resolve(nested(path, value))
    except SettingsError as error:
        said = f"{path}: expects " in str(error) and f"; got {value!r}" in str(error)
        assert said is not allowed  # a value in bounds may still not fit another setting
    else:
        assert allowed


ENUMS = [(path, kind.values) for path, kind in LEAVES if isinstance(kind, inspect.LiteralType)]


@pytest.mark.parametrize(("path", "values"), ENUMS)
def test_a_wrong_name_is_answered_with_the_right_ones(path: str, values: tuple[str, ...]) -> None:
    message = refused(nested(path, "boxcr"))
    assert message.startswith(f"{path}: expects ")
    assert all(f'"{value}"' in message for value in values)


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ({"coupling": {"stiffnes": 1}}, "coupling.stiffnes: there is no such setting; did you mean coupling.stiffness_npm?"),
        ({"link": {"up": {"los": 0.1}}}, "link.up.los: there is no such setting; did you mean link.up.loss?"),
        ({"users": [{"nam": "a"}]}, "users.0.nam: there is no such setting; did you mean users.0.name?"),
        ({"copling": {}}, "copling: there is no such setting; did you mean coupling?"),
        ({"session": {"seconds": 4}}, "session: there is no such setting; did you mean seconds?"),
        ({"stiffness_npm": 1}, "stiffness_npm: there is no such setting; did you mean coupling.stiffness_npm?"),
        ({"playout": {"zzz": 1}}, "playout.zzz: there is no such setting; known here: frames, late, redundancy, tank_mj"),
        ({"coupling": {"stiffness_npm": "stiff"}}, "coupling.stiffness_npm: expects a number, in N/m; got 'stiff'"),
        ({"coupling": {"stiffness_npm": float("nan")}}, "coupling.stiffness_npm: expects a number"),
        ({"coupling": {"stiffness_npm": float("inf")}}, "coupling.stiffness_npm: expects a number"),
        ({"playout": {"frames": "fast"}}, 'playout.frames: expects a whole number from 0 to 256 or "auto"; got \'fast\''),
        ({"playout": {"frames": True}}, 'playout.frames: expects a whole number from 0 to 256 or "auto"; got True'),
        ({"playout": {"frames": 1.5}}, 'playout.frames: expects a whole number from 0 to 256 or "auto"; got 1.5'),
        ({"coupling": {"compensate": 1}}, "coupling.compensate: expects true or false; got 1"),
        ({"coupling": 5}, "coupling: expects a table; got 5"),
        ({"users": []}, "users: expects a list of length at least 1; got []"),
        ({"name": "a/b"}, "name: expects letters, digits, blanks and . _ - with a letter or digit first; got 'a/b'"),
        ({"name": "lab\n"}, "name: expects letters, digits, blanks and . _ - with a letter or digit first; got 'lab\\n'"),
        ({"users": [{"name": "a"}, {"name": "a"}]}, "users: the name 'a' stands twice; give every user a name of their own"),
        ({"link": {"loss": 0.5, "burst_frames": 1.9}}, "link.burst_frames = 1.9 is too short for link.loss = 0.5"),
        ({"users": [{"tool": "pad"}]}, "users.0.tool = 'pad' is for object.kind"),
        ({"coupling": {"kind": "coupling", "server_step": "paper"}}, 'coupling.server_step = "paper" is a step of the wave'),
    ],
)  # fmt: skip
def test_what_is_said_of_a_mistake(table: dict[str, Any], message: str) -> None:
    assert refused(table).startswith(message)


@pytest.mark.parametrize("path", ["link.rate_kbps", "link.up.rate_kbps", "link.down.rate_kbps"])
@pytest.mark.parametrize(("value", "allowed"), [(0.0, True), (5e-324, False), (0.999, False), (1.0, True)])
def test_a_cap_is_none_or_one_that_lets_something_through(path: str, value: float, allowed: bool) -> None:
    if allowed:
        resolve(nested(path, value))
    else:
        said = f"{path}: expects a number of at least 1, or 0 for no cap, in kbit/s; got {value!r}"
        assert refused(nested(path, value)) == said


@pytest.mark.parametrize(("device_hz", "cure"), [(1000, 1024), (250, 256), (8192 + 1, 8192)])
def test_rates_that_do_not_fit_name_both_and_a_cure(device_hz: int, cure: int) -> None:
    message = refused({"rates": {"device_hz": device_hz}})
    assert f"rates.device_hz = {device_hz} is not a whole multiple of rates.network_hz = 128" in message
    assert message.endswith(f"use for instance device_hz = {cure}")
    assert resolve({"rates": {"device_hz": cure}}).rates.device_hz == cure


def test_each_person_has_a_rate_of_their_own() -> None:
    people = [{"name": "a"}, {"name": "b", "device_hz": 8192}]
    found = resolve({"rates": {"network_hz": 64}, "users": people})
    assert [seat_settings(found, seat).rates.ticks_per_frame for seat in (0, 1)] == [16, 128]
    message = refused({"users": people}, {"users.1.device_hz": 1000})
    assert message == (
        "users.1.device_hz = 1000 is not a whole multiple of rates.network_hz = 128; use for instance device_hz = 1024"
    )
    assert "users.1.device_hz: expects a whole number of at most 20000, in Hz; got 20001" in refused(
        {"users": people}, {"users.1.device_hz": 20001}
    )


@pytest.mark.parametrize(("device_hz", "taken"), [(1, False), (30, False), (249, False), (250, True)])
def test_a_loop_that_gives_force_to_a_hand_has_a_least_rate(device_hz: int, taken: bool) -> None:
    """Whatever the room's own rate."""
    for table, key in (
        ({"rates": {"device_hz": device_hz, "network_hz": 1}}, "rates.device_hz"),
        ({"rates": {"network_hz": 1}, "users": [{"name": "a", "device_hz": device_hz}]}, "users.0.device_hz"),
    ):
        if taken:
            assert seat_settings(resolve(table), 0).rates.device_hz == device_hz
        else:
            assert f"{key}: expects a whole number of at least 250, in Hz; got {device_hz}" in refused(table)


def test_bursts_as_long_as_independent_losses_are_accepted() -> None:
    for loss, burst in ((0.5, 2.0), (0.5, 1.0), (0.0, 1.5), (0.99, 100.0)):
        resolve({"link": {"loss": loss, "burst_frames": burst}})


def test_compensation_out_of_reach_names_the_user_the_setting_and_the_impedance() -> None:
    message = refused({"coupling": {"compensate": True, "stiffness_npm": 6000.0}})
    assert message.startswith("users.0 (anna): coupling.compensate: a felt stiffness of 6000 N/m is out of reach")
    advised = int(message.partition("coupling.impedance_nspm = ")[2].split()[0])
    assert advised == 26
    seat = seat_settings(
        resolve({"coupling": {"compensate": True, "stiffness_npm": 6e3, "impedance_nspm": advised}}), 0
    )
    assert seat.rendered_npm > 6000.0
    assert seat.predicted_stiffness(loop_frames=1.0) == pytest.approx(6000.0)


def test_compensation_that_would_render_beyond_the_wire_is_refused() -> None:
    stiffness = 5120.0 * (1.0 - 1e-6)
    assert "would render 5.12e+09 N/m, more than 1e+09" in refused(
        {"coupling": {"compensate": True, "stiffness_npm": stiffness}}
    )
    assert MOST_RENDERED_NPM == 1e9


AUTO_S = (
    2 * line_delay(Playout(frames="auto"), LinkProfile(delay_ms=10.0, jitter_ms=6.0), Rates(1024, 128)).ticks / 1024
)


@pytest.mark.parametrize(
    ("table", "impedance_nspm", "loop_s"),
    [
        (
            {"coupling": {"decimator": "lowpass"}, "link": {"delay_ms": 7.8125, "down": {"delay_ms": 15.625}}}, 20.0,
            (1 + 2 + 1 + 1) / 128 + 0.0241602,  # delay up and down, a frame of playout each, the filter
        ),
        ({"coupling": {"wave_filter_hz": 10.0}}, 20.0, (1 + 1 + 1) / 128 + 1 / (10.0 * pi)),  # 2 S
        (
            {"coupling": {"impedance_nspm": 40.0}, "link": {"delay_ms": 10.0, "jitter_ms": 6.0}, "playout": {"frames": "auto"}},
            40.0, AUTO_S + 1 / 128,
        ),
    ],
    ids=["delay, playout and lowpass", "wave filter", "what auto will hold"],
)  # fmt: skip
def test_compensation_counts_all_that_delays(table: dict[str, Any], impedance_nspm: float, loop_s: float) -> None:
    """1/K' = 1/K - C_line."""
    coupling = {"compensate": True, "stiffness_npm": 300.0, **table["coupling"]}
    seat = seat_settings(resolve({"playout": {"frames": 1}, **table, "coupling": coupling}), 0)
    assert 1 / seat.rendered_npm == pytest.approx(1 / 300 - loop_s / (2.0 * impedance_nspm), rel=1e-5)


def test_overrides_reach_sections_users_and_directions() -> None:
    table = {"users": [{"name": "anna"}, {"name": "ben"}], "link": {"delay_ms": 10.0}}
    settings = resolve(table, {
        "coupling.stiffness_npm": 500, "users.1.stiffness_npm": 700.0, "users.0.side": "right", "link.loss": 0.1,
        "link.up.loss": 0.2, "seed": 9,
    })  # fmt: skip
    assert (settings.seed, settings.users[0].side) == (9, "right")
    assert [schema.coupling_of(settings, user).stiffness_npm for user in settings.users] == [500.0, 700.0]
    assert settings.link.direction("up") == LinkProfile(delay_ms=10.0, loss=0.2)
    assert settings.link.direction("down") == LinkProfile(delay_ms=10.0, loss=0.1)
    assert table == {"users": [{"name": "anna"}, {"name": "ben"}], "link": {"delay_ms": 10.0}}, (
        "the file's is left alone"
    )


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("users.2.side", "left", "users.2.side: there is no user number 2 (users are numbered 0 to 1)"),
        ("users.anna.side", "left", "users.anna.side: there is no user number anna"),
        ("users.0", {}, "users.0: name a user's number and key, for instance users.0.stiffness_npm"),
        ("seed.x", 1, "seed.x: seed is a value, not a section"),
        ("coupling.stiffnes", 1, "coupling.stiffnes: there is no such setting; did you mean coupling.stiffness_npm?"),
        ("coupling.stiffness_npm", -1, "coupling.stiffness_npm: expects a number of at least 0, in N/m; got -1"),
    ],
)
def test_what_is_said_of_a_wrong_override(key: str, value: Any, message: str) -> None:
    assert refused({"seed": 1, "users": [{}, {}]}, {key: value}).startswith(message)


def test_overrides_are_split_at_the_first_equals_sign() -> None:
    assert parse_override(" link.up.loss = 0.1 ") == ("link.up.loss", "0.1")
    assert parse_override("users.0.device=sim:x?a=b") == ("users.0.device", "sim:x?a=b")
    for text in ("loss", "=3", ""):
        with pytest.raises(SettingsError, match=r"write it as section\.key=value"):
            parse_override(text)


def test_users_without_a_name_are_numbered_and_the_only_one_of_a_file_that_names_none_can_be_overridden() -> None:
    assert [user.name for user in resolve({"users": [{}, {"name": "ben"}, {}]}).users] == ["user1", "ben", "user3"]
    settings = resolve({}, {"users.0.impedance_nspm": 30.0})
    assert settings.users[0] == msgspec.structs.replace(resolve({}).users[0], impedance_nspm=30.0)


keys = st.sampled_from([*(path.rpartition(".")[2] for path, _ in LEAVES), "up", "users", "link"])
tables = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(keys, inner),
    max_leaves=10,
)


@given(st.dictionaries(st.sampled_from([*Settings.__struct_fields__, "nam"]), tables, max_size=4))
def test_any_table_resolves_or_is_refused(table: dict[str, Any]) -> None:
    try:
        settings = resolve(table)
    except SettingsError:
        return
    for seat in range(len(settings.users)):
        shared = seat_settings(settings, seat)
        assert msgspec.msgpack.decode(msgspec.msgpack.encode(shared), type=SeatSettings) == shared


def test_the_digest_binds_what_both_ends_must_agree_on_and_nothing_else() -> None:
    table: dict[str, Any] = {"users": [{"name": "anna"}, {"name": "ben"}]}
    same = ["seed=2", "seconds=3", "name=other", "users.0.hand=still", "users.0.device=sim:ideal", "link.delay_ms=5"]
    same.append("users.1.device_hz=1024")  # it is [rates]'s
    other = [
        "rates.device_hz=2048", "object.mass_kg=1", "object.axes=2", "playout.frames=3", "users.0.side=right",
        "coupling.stiffness_npm=5", "users.1.stiffness_npm=5", "users.0.name=eve", "coupling.decimator=none",
        "users.1.device_hz=2048", "rates.network_hz=64",
    ]  # fmt: skip

    def after(text: str) -> str:
        key, value = parse_override(text)
        return digest(resolve(table, {key: int(value) if value.isdigit() else value}))

    assert {after(text) for text in same} == {digest(resolve(table))}
    assert len({after(text) for text in other} | {digest(resolve(table))}) == len(other) + 1


def test_side_and_contact_of_a_seat() -> None:
    settings = resolve({"object": {"kind": "faces"}, "users": [{"side": "left"}, {"side": "right"}]})
    assert [seat_settings(settings, seat).side_sign for seat in (0, 1)] == [1.0, -1.0]
    assert seat_settings(settings, 0).one_sided
    assert not seat_settings(resolve({}), 0).one_sided


def test_predicted_stiffness_counts_the_papers_lagged_force() -> None:
    passive, paper = (seat_settings(resolve({"coupling": {"server_step": step}}), 0) for step in ("passive", "paper"))
    assert passive.predicted_stiffness(1.0) == pytest.approx(836.6, abs=0.05)
    assert paper.predicted_stiffness(3.0) == pytest.approx(passive.predicted_stiffness(1.0))
    assert seat_settings(resolve({"coupling": {"kind": "coupling"}}), 0).predicted_stiffness(1.0) is None


def test_another_network_by_name_takes_the_files_own_away_and_what_is_given_beside_it_stays() -> None:
    """Else `--set link.profile=satellite` on a file with 20 ms would be a satellite of 20 ms."""
    file = {"link": {"delay_ms": 20.0, "up": {"loss": 0.5}}}
    satellite = resolve({"link": {"profile": "satellite"}}).link
    assert resolve(file, {"link.profile": "satellite"}).link.direction("up") == satellite.direction("up")
    beside = resolve(file, {"link.loss": 0.25, "link.profile": "satellite"}).link.direction("up")
    assert beside == msgspec.structs.replace(satellite.direction("up"), loss=0.25)
    own = resolve({"link": {"profile": "satellite", "delay_ms": 20.0}}).link.direction("up")
    assert own == msgspec.structs.replace(satellite.direction("up"), delay_ms=20.0), "in one file the key stands above"


SCENE = {"object": {"kind": "scene", "file": "lift.xml", "axes": 3}}


@pytest.mark.parametrize(
    ("overrides", "words"),
    [
        ({"object.file": ""}, 'object.kind = "scene": object.file = "" names no scene; give an MJCF or URDF file'),
        ({"object.axes": 1}, "object.axes = 1, but a scene has 3 (places) or 6 (poses); set one of them"),
        (
            {"coupling.kind": "tdpa", "object.axes": 6},
            'coupling.kind = "tdpa" has no poses; set coupling.kind = "wave"',
        ),
        (
            {"coupling.server_step": "paper"},
            'coupling.server_step = "paper" does not fit it; set coupling.server_step = "passive"',
        ),
        (
            {"coupling.compensate": True},
            "coupling.compensate = true (anna), but it has no spring to stiffen; set it",
        ),
        (
            {"object.kind": "cube"},
            'object.file = \'lift.xml\' is for object.kind = "scene", not "cube"; leave one',
        ),
    ],
)
def test_settings_that_do_not_fit_a_scene(overrides: dict[str, Any], words: str) -> None:
    assert words in refused(SCENE, overrides)


def test_a_scene_is_bound_by_its_name_and_no_welcome_carries_its_path() -> None:
    here = resolve(SCENE)
    there = resolve(SCENE, {"object.file": "/somewhere/else/lift.xml"})
    assert digest(here) == digest(there)
    others = [{"object.file": "pile.xml"}, {"object.substeps": 8}, {"users.0.tool": "ball"}]
    assert len({digest(here), *(digest(resolve(SCENE, change)) for change in others)}) == 4
    seat = seat_settings(there, 0)
    assert b"somewhere" not in msgspec.msgpack.encode(seat)
    assert (seat.asked_npm, seat.predicted_stiffness(3.0), seat.one_sided) == (None, None, False)


def test_local_contact_predicts_the_stiffness_of_what_nobody_moves_alone() -> None:
    local, thing = {"coupling.kind": "local"}, {"users": [{"name": "anna"}], "coupling": {"stiffness_npm": 900.0}}
    assert seat_settings(resolve({**thing, "object": {"kind": "wall"}}, local), 0).predicted_stiffness(3.0) == 900.0
    assert seat_settings(resolve(SCENE, local), 0).predicted_stiffness(3.0) is None, "bodies that lines carry"


def test_the_digest_of_a_scene_is_that_of_its_text(tmp_path: Path) -> None:
    """Wherever the file lies; another text is another room."""
    digests = []
    for folder, text in (("here", "<mujoco/>"), ("there", "<mujoco/>"), ("elsewhere", "<mujoco> </mujoco>")):
        (tmp_path / folder).mkdir()
        file = tmp_path / folder / "box.xml"
        file.write_text(text)
        digests.append(digest(resolve({"object": {"kind": "scene", "axes": 3, "file": str(file)}})))
    assert digests[0] == digests[1] != digests[2]
