"""Sessions of a study in virtual time, with simulated devices."""

from collections.abc import Callable, Sequence
from pathlib import Path

from cogrip.devices.device import DeviceError
from cogrip.devices.simulated.device import SimulatedDevice
from cogrip.experiments.study.conductor import Ended, Quit
from cogrip.experiments.study.phases import Phase, PhaseWatch, phase_begun
from cogrip.experiments.study.spread import varied
from cogrip.experiments.study.study_file import Study
from cogrip.experiments.study.trial import Event, begun_by, ended_by
from cogrip.protocol.settings import Settings
from cogrip.results.laboratory_run import run_laboratory
from cogrip.results.measures.goal import Goal, GoalWatch
from cogrip.sim.laboratory import Laboratory


class LaboratorySessions:
    """See `conductor.Sessions`. With end = "goal" a session ends where its goal, or its task, is reached, and else by time."""

    def __init__(self, study: Study, stopped: Callable[[], bool] = lambda: False) -> None:
        self._study, self._stopped = study, stopped

    def run(self, settings: Settings, folder: Path, goal: Goal, phases: Sequence[Phase]) -> Ended:
        """Run one, with the markers of a live one. Raises Quit once `stopped` returns True, after the session's files are closed."""
        watch, clock, hands_begin = GoalWatch(goal), PhaseWatch(phases), self._study.simulated.begins
        waits = hands_begin in [phase.name for phase in phases]

        def reached(laboratory: Laboratory) -> bool:
            if goal.stated:
                return watch.look(laboratory.seconds, laboratory.room.world.position.tolist())
            task = laboratory.room.world.task_account()
            return bool(task and task["reached"])

        how = "time"

        def hands(laboratory: Laboratory) -> list[SimulatedDevice]:
            return [person.device for person in laboratory.people if isinstance(person.device, SimulatedDevice)]

        def begin(laboratory: Laboratory) -> None:
            laboratory.mark(begun_by(folder.name))
            for device in hands(laboratory) if waits else ():
                device.wait()
            begin_phases(laboratory)

        def begin_phases(laboratory: Laboratory) -> None:
            for phase in clock.look(laboratory.seconds):
                laboratory.mark(phase_begun(folder.name, phase.name))
                for device in hands(laboratory) if phase.name == hands_begin else ():
                    device.begin()

        def over(laboratory: Laboratory) -> bool:
            nonlocal how
            begin_phases(laboratory)
            if self._study.end == "goal" and reached(laboratory):
                how = "goal"
            if how == "goal" or laboratory.seconds >= laboratory.frames / settings.rates.network_hz:
                laboratory.mark(ended_by(folder.name, how))
            return how == "goal" or self._stopped()

        settings = varied(settings, self._study.simulated.spread, self._study.seed)
        folder.mkdir(parents=True)
        try:
            outcome = run_laboratory(settings, folder, begin=begin, over=over)
        except DeviceError as error:
            return Ended(Event.FAILED, str(error))
        if self._stopped():
            raise Quit
        if outcome.unstable:
            return Ended(Event.FAILED, f"unstable: {outcome.unstable[0]}")
        faults = [user for user in outcome.summary["users"] if user["saturated"] and user["state"] == "fault"]
        if faults:
            return Ended(Event.FAILED, f"saturated: {faults[0]['name']}: {faults[0]['reason']}")
        return Ended(Event.ENDED, how)
