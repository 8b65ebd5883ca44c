"""Stiffness that is felt through lossy networks, against the prediction, and against the charge that takes it away."""

from collections.abc import Callable
from statistics import mean
from typing import Any

import pytest

from cogrip.analysis.feel import felt_probe as felt
from cogrip.analysis.feel.felt_probe import LAST_S
from cogrip.protocol.settings.room import resolve
from cogrip.protocol.settings.sections import Settings
from cogrip.results.verdict.felt_as_intended import MOST_LENT
from cogrip.sim.laboratory import Laboratory

from tests.extent import every, long
from tests.sim.session_measures import MARGINS, allowed, laboratory_of

PREDICTED = 0.1  # of the prediction: what losses may change while the credit pays
Look = Callable[[Laboratory], Any]


def lossy(profile: str, seed: int, **playout: Any) -> Settings:
    users = [{"name": "anna"}, {"name": "ben"}]
    coupling = {"stiffness_npm": 2000.0, "impedance_nspm": 20.0}
    link = {"profile": profile}
    return resolve({"seed": seed, "coupling": coupling, "link": link, "playout": playout, "users": users})


def probed(settings: Settings) -> list[tuple[float, float, dict[str, float]]]:
    """Return for each person the stiffness felt and that predicted over the time that `measure_felt` looks at, and the margins.

    The playout delay follows the network, so the mean is that of the compliance, frame by frame.
    """
    compliances: list[list[float]] = [[] for _ in settings.users]
    sessions: list[Laboratory] = []

    class Watched(Laboratory):
        def run(self, each_tick: Look | None = None, each_frame: Look | None = None) -> None:
            sessions.append(self)
            super().run(each_tick, lambda now: (each_frame(now), look(now)))  # type: ignore[misc]

    def look(now: Laboratory) -> None:
        for number, person in enumerate(now.people):
            coupling = person.core.coupling
            if now.seconds > now.settings.seconds - LAST_S and (loop := coupling.loop_frames()) is not None:
                seat = now.room.seats[number].settings
                npm = seat.predicted_stiffness(loop, max(0.0, coupling.deficit_frames))
                assert npm is not None
                compliances[number].append(1.0 / npm)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(felt, "Laboratory", Watched)
        measured = felt.measure_felt(settings)
    (laboratory,) = sessions
    found = []
    for number, person in enumerate(laboratory.people):
        seat = laboratory.room.seat_account(number)
        margins = (seat.up_margin_j, person.core.coupling.down_margin_j, seat.line_margin_j)
        values = dict(zip(MARGINS, margins, strict=True))
        assert None not in margins
        found.append((measured[number].felt_npm or 0.0, 1.0 / mean(compliances[number]), values))
    return found


@pytest.mark.long
@pytest.mark.parametrize("seed", every(6, range(1, 7)))
@pytest.mark.parametrize("profile", ["wifi", long("wan"), "lte", long("satellite")])
def test_what_is_predicted_is_felt_while_the_credit_pays(profile: str, seed: int) -> None:
    for felt_npm, predicted_npm, margins in probed(lossy(profile, seed)):
        assert all(margin_j >= -allowed(key) - 1e-12 for key, margin_j in margins.items())
        paid = all(margins[key] > -MOST_LENT * allowed(key) for key in MARGINS[:2])
        assert felt_npm > 0.0
        assert not paid or felt_npm == pytest.approx(predicted_npm, rel=PREDICTED)


@pytest.mark.long
def test_without_a_credit_the_hand_feels_the_gaps() -> None:
    """The same network and seed: the test above can fail."""
    people = probed(lossy("wan", 1, tank_mj=0.0))
    assert min(felt_npm / predicted_npm for felt_npm, predicted_npm, _ in people) < 1.0 - PREDICTED


@pytest.mark.parametrize("profile", every(4, ["lte", "lan", "wifi", "wan"]))
def test_the_account_of_who_has_left_predicts_what_was_felt_before(profile: str) -> None:
    """Once the object is released, hardly a wave plays: what is owed, over that, says nothing of the hand."""
    hand = "reach&amplitude_m=0.005&stroke_s=1&delay_s=0.5&stop_s=1.5"
    laboratory = laboratory_of(
        seed=2, seconds=12.0, object={"kind": "wall"}, link={"profile": profile}, users=[{"name": "anna", "hand": hand}]
    )
    while laboratory.seconds < 8.0:
        laboratory.frame()
    core = laboratory.people[0].core
    felt_npm = core.force_n[0] / core.position_m[0]
    laboratory.leave(0)
    while core.account is None:
        laboratory.frame()
    assert core.account.predicted_stiffness_npm == pytest.approx(felt_npm, rel=0.02)
    assert core.account.felt_stiffness_npm == pytest.approx(felt_npm, rel=0.02)


@pytest.mark.parametrize("seed", every(3, (12, 15, 16)))
def test_a_playout_that_waits_steps_the_force_of_a_hand_that_presses_by_little(seed: int) -> None:
    """The wait of a tick fades by an eighth of what a missing frame fades: 0.6 N at once before. A count is 0.2 N."""
    laboratory = laboratory_of(
        seed=seed, seconds=10.0, object={"kind": "wall"}, link={"profile": "wifi"},
        users=[{"name": "anna", "device": "sim:ideal", "hand": "push&force_n=6&start_s=0.3"}],
    )  # fmt: skip
    core = laboratory.people[0].core
    forces: list[float] = []
    laboratory.run(lambda now: forces.append(core.force_n[0]) if now.seconds > 7.0 else None)
    assert core.coupling.down.receiver.playout_account().repeated > 0
    assert max(abs(force - 6.0) for force in forces) < 0.4
