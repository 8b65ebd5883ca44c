"""Sessions of a study in virtual time, with simulated devices."""

from collections.abc import Callable, Sequence
from pathlib import Path

from cogrip.devices.device import DeviceError
from cogrip.devices.simulated.simulated_device import SimulatedDevice
from cogrip.experiments.study.conductor import Quit, TrialEnded
from cogrip.experiments.study.phases import Phase, PhaseWatch, phase_begun
from cogrip.experiments.study.spread import varied
from cogrip.experiments.study.study_file import Study
from cogrip.experiments.study.trial import TrialEvent, begun_by, ended_by
from cogrip.protocol.settings.sections import Settings
from cogrip.results.measures.goal import Goal, GoalWatch
from cogrip.results.writing.laboratory_run import run_laboratory
from cogrip.sim.laboratory import Laboratory


class LaboratorySessions:
    """See `conductor.Sessions`. With end = "goal" a session ends where its goal, or its task, is reached, and else by time."""

    def __init__(self, study: Study, stopped: Callable[[], bool] = lambda: False) -> None:
        self._study, self._stopped = study, stopped

    def run(self, settings: Settings, folder: Path, goal: Goal, phases: Sequence[Phase]) -> TrialEnded:
        """Run one, with the markers of a live one. Raises Quit once `stopped` returns True, after its files are closed."""
        rehearsal = _Rehearsal(self._study, folder.name, goal, phases)
        settings = varied(settings, self._study.simulated.spread, self._study.seed)
        folder.mkdir(parents=True)
        try:
            outcome = run_laboratory(
                settings,
                folder,
                begin=rehearsal.begin,
                over=lambda laboratory: rehearsal.over(laboratory) or self._stopped(),
            )
        except DeviceError as error:
            return TrialEnded(TrialEvent.FAILED, str(error))
        if self._stopped():
            raise Quit
        if outcome.unstable:
            return TrialEnded(TrialEvent.FAILED, f"unstable: {outcome.unstable[0]}")
        faults = [user for user in outcome.summary["users"] if user["saturated"] and user["state"] == "fault"]
        if faults:
            return TrialEnded(TrialEvent.FAILED, f"saturated: {faults[0]['name']}: {faults[0]['reason']}")
        return TrialEnded(TrialEvent.ENDED, rehearsal.how)


class _Rehearsal:
    """One session: its markers, its phases and its end. how: it ended."""

    def __init__(self, study: Study, run: str, goal: Goal, phases: Sequence[Phase]) -> None:
        self.how = "time"
        self._by_goal, self._goal, self._watch = study.end == "goal", goal, GoalWatch(goal)
        self._run, self._phases = run, PhaseWatch(phases)
        self._hands_begin = study.simulated.begins
        self._waits = self._hands_begin in [phase.name for phase in phases]

    def begin(self, laboratory: Laboratory) -> None:
        """Mark the beginning; let hands wait for their phase."""
        laboratory.mark(begun_by(self._run))
        for device in _hands(laboratory) if self._waits else ():
            device.wait()
        self._begin_phases(laboratory)

    def over(self, laboratory: Laboratory) -> bool:
        """Begin the phases that are due after a frame. Return whether the goal is reached."""
        self._begin_phases(laboratory)
        if self._by_goal and self._reached(laboratory):
            self.how = "goal"
        if self.how == "goal" or laboratory.seconds >= laboratory.frames / laboratory.settings.rates.network_hz:
            laboratory.mark(ended_by(self._run, self.how))
        return self.how == "goal"

    def _begin_phases(self, laboratory: Laboratory) -> None:
        for phase in self._phases.look(laboratory.seconds):
            laboratory.mark(phase_begun(self._run, phase.name))
            for device in _hands(laboratory) if phase.name == self._hands_begin else ():
                device.begin()

    def _reached(self, laboratory: Laboratory) -> bool:
        if self._goal.stated:
            return self._watch.look(laboratory.seconds, laboratory.room.world.position.tolist())
        task = laboratory.room.world.progress.account()
        return bool(task and task["reached"])


def _hands(laboratory: Laboratory) -> list[SimulatedDevice]:
    return [person.device for person in laboratory.people if isinstance(person.device, SimulatedDevice)]
