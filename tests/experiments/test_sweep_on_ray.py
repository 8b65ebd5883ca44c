"""Tests of a sweep on a Ray cluster, two nodes of which one is killed half-way, and of the tasks that Ray is given."""

import json
import sys
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from cogrip.experiments.experiment import run_case
from cogrip.experiments.folder import CELLS, ExperimentFolder
from cogrip.experiments.ray_cluster import ClusterError, RayWorkers
from cogrip.experiments.runner import run_experiment
from cogrip.experiments.sweep.grid import parse_axis
from cogrip.experiments.sweep.query import Job, measure_case, prepare
from cogrip.machine.stop import Stop
from cogrip.protocol.settings.room import resolve

# what ray itself warns of, and of its own; processes of a node that was killed are gone when ray wants to tell them
pytestmark = [pytest.mark.filterwarnings("ignore::Warning")]


@pytest.fixture
def cluster(monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    pytest.importorskip("ray", reason="the extra `cluster` has no ray for this Python")
    monkeypatch.setenv("RAY_USAGE_STATS_ENABLED", "0")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        from ray.cluster_utils import Cluster

    node = {"num_cpus": 1, "object_store_memory": 100 * 1024 * 1024, "include_dashboard": False}
    both = Cluster(initialize_head=True, head_node_args=node)
    yield both
    both.shutdown()


class TasksOfRay(ModuleType):
    """Stands for `ray`: keeps the tasks that it is given, and ends the oldest whenever it is asked to wait."""

    def __init__(self) -> None:
        super().__init__("ray")
        self.batches: list[int] = []
        self.cancelled, self.most_waiting = 0, 0

    def init(self, **where: Any) -> None: ...

    def shutdown(self) -> None: ...

    def remote(self, run: Callable[..., Any]) -> Any:
        task = ModuleType("task")
        task.options = lambda **_: task
        task.remote = lambda measure, jobs: self.batches.append(len(jobs)) or (lambda: run(measure, jobs))
        return task

    def cluster_resources(self) -> dict[str, float]:
        return {"CPU": 1.0}

    def wait(self, tasks: list[Any], **_: Any) -> tuple[list[Any], list[Any]]:
        self.most_waiting = max(self.most_waiting, len(tasks))
        return tasks[:1], tasks[1:]

    def get(self, task: Any) -> Any:
        return task()

    def cancel(self, task: Any, force: bool) -> None:
        self.cancelled += force


@pytest.mark.sample(1)
@pytest.mark.parametrize("stop_at", [0, 4])
def test_ray_is_given_few_tasks_at_a_time_and_each_case_once(
    stop_at: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    tasks, stop = TasksOfRay(), Stop()
    monkeypatch.setitem(sys.modules, "ray", tasks)
    sweep = prepare(resolve({"users": [{"name": "a"}]}), [parse_axis("seed=1:100:100")], ["lifted.stable"])
    folder = ExperimentFolder(tmp_path / "out", sweep)

    def stop_there(finished: int) -> None:
        if stop_at and finished >= stop_at * sweep.batch:
            stop.reason = "interrupted"

    with RayWorkers(stop=stop) as workers:
        report = run_experiment(sweep, folder, workers, stop_there)
    assert tasks.most_waiting == 4
    if stop_at:
        assert (report.computed, tasks.cancelled) == (stop_at * sweep.batch, 2)
    else:
        assert (report.computed, tasks.batches) == (100, [16] * 6 + [4])


@pytest.mark.long
def test_a_killed_node_costs_no_case(cluster: Any, tmp_path: Path) -> None:
    doomed = cluster.add_node(num_cpus=1, object_store_memory=100 * 1024 * 1024)
    settings = resolve({"seconds": 1.0, "users": [{"name": "a"}, {"name": "b"}]})
    sweep = prepare(settings, [parse_axis("seed=1:24:24")], ["passive", "users.0.peak_force_n"])
    folder = ExperimentFolder(tmp_path / "out", sweep)
    killed = False

    def kill_at_half(finished: int) -> None:
        nonlocal killed
        if finished >= 12 and not killed:
            killed = True
            cluster.remove_node(doomed, allow_graceful=False)

    with RayWorkers(cluster.address) as workers:
        assert sys.modules["ray"].cluster_resources()["CPU"] == 2
        report = run_experiment(sweep, folder, workers, kill_at_half)
    assert killed
    assert (report.cases, report.computed, report.failed) == (24, 24, {})
    rows = [json.loads(line) for line in (tmp_path / "out" / CELLS).read_text().splitlines()]
    assert sorted(row["cell"] for row in rows) == list(range(24))
    grid = sweep.grid
    for case in (0, 11, 23):
        here = run_case(measure_case, Job(case, grid.base, grid.values(case), sweep.columns))
        assert folder.finished[case].measures == here.measures


def test_an_unknown_cluster(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "ray", TasksOfRay())
    with pytest.raises(ClusterError, match=r"no Ray cluster at 127\.0\.0\.1:1"), RayWorkers("127.0.0.1:1"):
        pass
