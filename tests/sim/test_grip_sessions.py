"""Sessions of a hand with a gripper that has force: what a spring between the fingers feels like, energy on every network."""

from math import sqrt
from pathlib import Path
from typing import Any

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from cogrip.protocol.line.concealment import held_force
from cogrip.protocol.settings.network_profiles import PROFILES
from cogrip.protocol.settings.room import SettingsError, resolve
from cogrip.results.report.tables import people_table
from cogrip.results.verdict.felt_as_intended import MOST_CONTROLLED
from cogrip.results.writing.laboratory_run import run_laboratory
from cogrip.results.writing.summary import of_laboratory
from cogrip.sim.laboratory import Laboratory

from tests.extent import every, long
from tests.sim.session_measures import assert_plays_again, by_frame, by_tick, laboratory_of, least_margin

K_NPM, REST_M = 600.0, 0.02
SPRING = f"""<mujoco><option gravity="0 0 0"/><worldbody>
  <body name="hand">
    <joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 1 0"/><joint type="slide" axis="0 0 1"/>
    <geom type="sphere" size=".005" pos="0 -.02 0" mass=".03"/>
    <body name="finger">
      <joint type="slide" axis="0 1 0" stiffness="{K_NPM}" springref="{REST_M}"/>
      <geom type="sphere" size=".005" pos="0 .06 0" mass=".02"/>
    </body>
  </body>
  <body name="block" pos=".06 0 0"><freejoint/><geom type="box" size=".006 .006 .015" mass=".05"/></body>
</worldbody></mujoco>"""
SQUEEZE = "sim:gripper?open_m=0.02&squeeze_m=0.008&squeeze_s=0.2&fingers_s=0.3"
FRICTIONLESS = "&grip_friction_n=0&friction_n=0&hold_s=100"
EXACT = "&resolution_m=0&grip_resolution_m=0"
PINCH = {"name": "anna", "device": SQUEEZE, "hand": "hold", "tool": "pinch:hand"}


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    file = tmp_path_factory.mktemp("spring") / "spring.xml"
    file.write_text(SPRING)
    return {"kind": "scene", "file": str(file), "axes": 3}


def session(scene: dict[str, Any], *people: dict[str, Any], **tables: Any) -> Laboratory:
    return laboratory_of(**{"object": scene, "users": people or (PINCH,), "seconds": 2.0, **tables})


def least(laboratory: Laboratory) -> float:
    """Return the least margin of all lines above their credit, and of all devices [J]; the limiter has not acted."""
    summary = of_laboratory(laboratory)
    assert summary["server"]["energy_limiter"]["limited_frames"] == 0
    assert summary["server"]["energy_balance_error_j"] <= 1e-14
    ends = [user["energy"]["device_margin_j"] for user in summary["users"]]
    return min(least_margin(summary) + 1e-12, *ends)


@pytest.mark.sample(1)
@pytest.mark.parametrize(
    ("b_nspm", "link", "encoders", "within"),
    [
        (5.0, {"delay_ms": 10.0}, EXACT, 1e-3),
        (10.0, {"delay_ms": 10.0}, EXACT, 1e-3),
        (10.0, {"delay_ms": 10.0}, "", 0.02),
        long(10.0, {"profile": "lan"}, "", 0.02),
        long(8.0, {"delay_ms": 40.0}, EXACT, 1e-3),
    ],
)
def test_a_spring_between_the_fingers_is_in_series_with_the_line(
    scene: dict[str, Any], b_nspm: float, link: dict[str, Any], encoders: str, within: float
) -> None:
    """1/K_felt = 1/K + T_loop / (2 b_g), over the last second: b_g is the gripper's own, that of the places is 20 N s/m."""
    coupling = {"impedance_nspm": 20.0, "grip_impedance_nspm": b_nspm}
    squeezing = {**PINCH, "device": f"{SQUEEZE}{FRICTIONLESS}{encoders}"}
    held = session(scene, squeezing, coupling=coupling, link=link, seconds=4.0)
    device: Any = held.people[0].device
    felt = by_frame(held, lambda _: (device.force_n[3], device.position_m[3] - REST_M))
    seat = held.people[0].core.seated
    assert seat.safety.state == "live"
    loop_frames = seat.coupling.loop_frames()
    loop_s = (loop_frames + seat.rest.mean_deficit_frames()) * seat.settings.rates.frame_s
    expected = 1.0 / (1.0 / K_NPM + loop_s / (2.0 * b_nspm))
    force_n, stretch_m = (sum(column) / 128 for column in zip(*felt[-128:], strict=True))
    assert force_n < -1.0
    assert force_n / stretch_m == pytest.approx(expected, rel=within)
    assert least(held) >= 0.0


@pytest.mark.long
@pytest.mark.parametrize(
    ("network", "seed", "squeeze_m", "within"),
    [
        ("wifi", 1, 0.008, 0.02), ("wan", 1, 0.008, 0.02), ("wan", 1, 0.018, 0.02), ("wifi", 3, 0.018, 0.02),
        *[
            long(network, seed, squeeze_m, 0.05)
            for network in ("wifi", "wan", "lte") for seed in range(2, 7) for squeeze_m in (0.008, 0.018)
        ],
    ],
)  # fmt: skip
def test_what_both_lines_owe_is_all_by_which_a_lossy_network_softens_the_fingers(
    scene: dict[str, Any], network: str, seed: int, squeeze_m: float, within: float
) -> None:
    """x = F (1/K + T_loop / (2 b_g)) + T_n (D_down - D_up) / sqrt(2 b_g), means over 2 s: theory 8.8.

    A force that the credit holds needs no D. Of the 30 long sessions 24 are within 2 %; in others a gap is just over. Where
    it is more, the device port changed what is felt, and the run says so.
    """
    b_nspm, coupling = 10.0, {"impedance_nspm": 20.0, "grip_impedance_nspm": 10.0}
    device = SQUEEZE.replace("squeeze_m=0.008", f"squeeze_m={squeeze_m}")
    squeezing = {**PINCH, "device": f"{device}{FRICTIONLESS}{EXACT}"}
    held = session(scene, squeezing, coupling=coupling, link={"profile": network}, seed=seed, seconds=8.0)
    core, device, room = held.people[0].core, held.people[0].device, held.room

    def row(_: Laboratory) -> tuple[float, ...]:
        owed = core.coupling.deficit[3] - room.seats[0].port.deficit[3]
        return device.force_n[3], REST_M - device.position_m[3], core.coupling.loop_frames(), owed

    rows = by_frame(held, lambda now: row(now) if now.seconds >= 6.0 else None)[-256:]
    force_n, squeezed_m, loop_frames, owed = (sum(column) / len(rows) for column in zip(*rows, strict=True))
    frame_s = 1.0 / 128.0
    bare_m = -force_n * (1.0 / K_NPM + loop_frames * frame_s / (2.0 * b_nspm))
    expected_m = bare_m + frame_s * owed / sqrt(2.0 * b_nspm)
    [user] = of_laboratory(held)["users"]
    assert abs(squeezed_m / expected_m - 1.0) < within or user["controlled"] > MOST_CONTROLLED
    if -force_n < held_force(b_nspm, 1e-3, frame_s, 4) and within < 0.05:
        assert squeezed_m == pytest.approx(bare_m, rel=within)


@pytest.mark.sample(1)
@pytest.mark.parametrize("network", every(2, PROFILES))
def test_a_gripper_is_passive_on_every_network(scene: dict[str, Any], network: str) -> None:
    held = session(scene, link={"profile": network}, seconds=3.0)
    held.run()
    assert not held.incident
    assert held.people[0].core.safety.state == "live"
    assert least(held) >= 0.0


@pytest.mark.long
@settings(max_examples=43, deadline=None)
@given(
    network=st.sampled_from(sorted(PROFILES)),
    seed=st.integers(0, 2**20),
    coupling=st.fixed_dictionaries(
        {"grip_impedance_nspm": st.floats(2.0, 40.0), "impedance_nspm": st.floats(5.0, 60.0)}
    ),
    squeeze_m=st.floats(-0.02, 0.02),
    fingers_npm=st.floats(0.0, 1500.0),
)
@example(
    network="lan", seed=60000, coupling={"grip_impedance_nspm": 14.0, "impedance_nspm": 8.7}, squeeze_m=-0.011,
    fingers_npm=900.0,
)  # fmt: skip
def test_no_gripper_brings_energy_about(
    scene: dict[str, Any], network: str, seed: int, coupling: dict[str, float], squeeze_m: float, fingers_npm: float
) -> None:
    device = f"sim:gripper?open_m=0.02&squeeze_s=0.1&fingers_s=0.2&hold_s=0.2&squeeze_m={squeeze_m}"
    anna = {**PINCH, "device": f"{device}&fingers_stiffness_npm={fingers_npm}", "hand": "tremor&tremor_m=0.0005"}
    held = session(scene, anna, coupling=coupling, link={"profile": network}, seed=seed, seconds=4.0)
    held.run()
    gripper = held.people[0].device.capability.gripper
    assert gripper is not None
    if held.incident:  # fingers that pull harder than the motor can are let go
        assert "the force sits at its limit" in held.incident
        assert fingers_npm * (REST_M - squeeze_m) > gripper.peak_force_n
    assert least(held) >= 0.0


MORE = {
    "scaled": {"position_scale": 2.0, "force_scale": 0.5, "rotation": "y -x z"},
    "aided": {"workspace_limit_m": "auto", "gravity_compensation": True},
    "clutched": {"clutch_button": 1, "device": f"{SQUEEZE}&press=1@0.6+0.4"},
}


@pytest.mark.long
@pytest.mark.parametrize("name", every(2, MORE))
def test_scales_limits_and_clutch_keep_the_energy_of_a_gripper(scene: dict[str, Any], name: str) -> None:
    held = session(scene, {**PINCH, "hand": "tremor&tremor_m=0.001", **MORE[name]}, link={"delay_ms": 10.0})
    held.run()
    assert held.people[0].core.safety.state == "live"
    assert least(held) >= 0.0


def test_the_clutch_holds_the_opening(scene: dict[str, Any]) -> None:
    held = session(scene, {**PINCH, **MORE["clutched"], "device": f"{SQUEEZE}&press=1@0.1+3"}, seconds=1.0)
    held.run()
    assert held.people[0].device.position_m[3] < 0.012
    assert held.room.world.proxy(0)[3] == pytest.approx(REST_M, abs=1e-4)


@pytest.mark.long
def test_an_impedance_that_is_chosen_takes_the_grippers_along(scene: dict[str, Any]) -> None:
    held = session(
        scene, coupling={"impedance_nspm": "auto", "grip_impedance_nspm": 5.0}, link={"profile": "wifi"}, seconds=4.0
    )
    held.run()
    seat, world = held.people[0].core.seated, held.room.world
    ratio = 5.0 / seat.settings.coupling.impedance_nspm
    assert world.further_impedance[0, 0] == pytest.approx(ratio * world.impedance[0, 0])
    assert least(held) >= 0.0


@pytest.mark.long
def test_a_person_without_a_gripper_is_as_without_the_one_beside(scene: dict[str, Any], tmp_path: Path) -> None:
    """Their hand is away from all: force and waves of three axes, the same to the bit, whoever is in the next seat."""
    ben = {"name": "ben", "device": "sim:phantom", "hand": "reach&amplitude_m=-0.02", "side": "right"}
    forces = []
    for anna in (PINCH, {"name": "anna", "device": "sim:phantom", "hand": "hold"}):
        held = session(scene, anna, ben, seconds=1.0)
        forces.append(by_tick(held, lambda now: now.people[1].core.seated.wrench))
        assert len(forces[-1][-1]) == 3
    assert forces[0] == forces[1]


def test_observers_are_told_the_opening_and_the_summary_the_largest_force(scene: dict[str, Any]) -> None:
    held = session(scene, seconds=1.0)
    peak_n = max(by_tick(held, lambda now: abs(now.people[0].device.force_n[3])))
    port = held.room.seats[0].port
    assert port.handle.grip_m == pytest.approx(held.people[0].device.position_m[3], abs=5e-4)
    summary = of_laboratory(held)
    [user] = summary["users"]
    assert user["peak_grip_n"] == pytest.approx(peak_n)
    assert user["peak_force_n"] < 0.1, "the arm's alone"
    table = people_table(summary)
    assert not isinstance(table, str)
    cells = {row.label: (row.unit, row.cells[0].text) for row in table.rows if not isinstance(row, str)}
    assert cells["peak force of the gripper"] == ("N", f"{peak_n:.2f}")
    assert "peak torque" not in cells
    assert len(user["position_m"]) == len(user["proxy_m"]) == len(user["force_n"]) == 4


@pytest.mark.long
def test_a_session_with_a_gripper_plays_again_bit_by_bit(scene: dict[str, Any], tmp_path: Path) -> None:
    users = (PINCH, {"name": "ben", "device": "sim:phantom", "side": "right"})
    table = {"object": scene, "users": users, "seconds": 0.6, "link": {"loss": 0.1, "jitter_ms": 5.0}}
    run_laboratory(resolve(table), tmp_path)
    assert len(list(tmp_path.glob("*.mcap"))) == 3
    assert_plays_again(tmp_path)


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"object": {"axes": 6}}, 'tool = "pinch" moves in places alone; set object.axes = 3'),
        ({"coupling": {"kind": "local"}}, 'coupling.kind = "local" has no gripper; set coupling.kind = "wave"'),
        ({"playout": {"redundancy": 20}}, "of 4 axes is more than a datagram holds; set it to at most 19"),
        ({"coupling": {"grip_impedance_nspm": 0.0}}, "grip_impedance_nspm"),
        ({"object": {"kind": "cube"}}, "users.0.tool = 'pinch:hand' is for object.kind = \"scene\""),
    ],
)
def test_settings_without_a_place_for_a_gripper_have_their_line(
    scene: dict[str, Any], changed: dict[str, Any], words: str
) -> None:
    table = {"object": scene, "users": (PINCH,), **{key: value for key, value in changed.items() if key != "object"}}
    table["object"] = {**scene, **changed.get("object", {})}
    if table["object"]["kind"] == "cube":
        del table["object"]["file"]
    with pytest.raises(SettingsError) as caught:
        resolve(table)
    assert words in str(caught.value)
