"""Sessions of a study in virtual time, with simulated devices."""

from collections.abc import Callable
from pathlib import Path

from cogrip.devices.device import DeviceError
from cogrip.experiments.study.conductor import Ended, Quit
from cogrip.experiments.study.spread import varied
from cogrip.experiments.study.study_file import Study
from cogrip.experiments.study.trial import Event
from cogrip.protocol.settings.sections import Settings
from cogrip.results.laboratory_run import run_laboratory
from cogrip.results.measures.goal import Goal, GoalWatch
from cogrip.sim.laboratory import Laboratory


class LaboratorySessions:
    """See `conductor.Sessions`. With end = "goal" a session ends where its goal, or its task, is reached, and else by time."""

    def __init__(self, study: Study, stopped: Callable[[], bool] = lambda: False) -> None:
        self._study, self._stopped = study, stopped

    def run(self, settings: Settings, folder: Path, goal: Goal, title: str) -> Ended:
        """Run one. Raises Quit once `stopped` returns True, after the session's files are closed."""
        watch = GoalWatch(goal)

        def reached(laboratory: Laboratory) -> bool:
            if goal.stated:
                return watch.look(laboratory.seconds, laboratory.room.world.position.tolist())
            task = laboratory.room.world.progress.account()
            return bool(task and task["reached"])

        how = "time"

        def over(laboratory: Laboratory) -> bool:
            nonlocal how
            if self._study.end == "goal" and reached(laboratory):
                how = "goal"
            return how == "goal" or self._stopped()

        settings = varied(settings, self._study.simulated.spread, self._study.seed)
        folder.mkdir(parents=True)
        try:
            outcome = run_laboratory(settings, folder, over=over)
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
