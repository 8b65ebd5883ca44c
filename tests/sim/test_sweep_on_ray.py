"""Test of a sweep on a Ray cluster of two nodes, one of which is killed half-way: every case once, with the same result."""

import json
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from cogrip.protocol.settings import resolve
from cogrip.sim.experiments.experiment import run_case
from cogrip.sim.experiments.folder import CELLS, ExperimentFolder
from cogrip.sim.experiments.ray_cluster import ClusterError, RayWorkers
from cogrip.sim.experiments.runner import run_experiment
from cogrip.sim.experiments.sweep.grid import parse_axis
from cogrip.sim.experiments.sweep.query import Job, measure_case, prepare

ray = pytest.importorskip("ray", reason="the extra `cluster` has no ray for this Python")

# what ray itself warns of, and of its own; processes of a node that was killed are gone when ray wants to tell them
pytestmark = [pytest.mark.filterwarnings("ignore::Warning")]


@pytest.fixture
def cluster(monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    monkeypatch.setenv("RAY_USAGE_STATS_ENABLED", "0")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        from ray.cluster_utils import Cluster

    node = {"num_cpus": 1, "object_store_memory": 100 * 1024 * 1024, "include_dashboard": False}
    both = Cluster(initialize_head=True, head_node_args=node)
    yield both
    both.shutdown()


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
        assert ray.cluster_resources()["CPU"] == 2
        report = run_experiment(sweep, folder, workers, kill_at_half)
    assert killed
    assert (report.cases, report.computed, report.failed) == (24, 24, {})
    rows = [json.loads(line) for line in (tmp_path / "out" / CELLS).read_text().splitlines()]
    assert sorted(row["cell"] for row in rows) == list(range(24))
    grid = sweep.grid
    for case in (0, 11, 23):
        here = run_case(measure_case, Job(case, grid.base, grid.values(case), sweep.columns))
        assert folder.finished[case].measures == here.measures


def test_an_unknown_cluster() -> None:
    with pytest.raises(ClusterError, match=r"no Ray cluster at 127\.0\.0\.1:1"), RayWorkers("127.0.0.1:1"):
        pass
