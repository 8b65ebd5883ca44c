"""`dev.py bench cluster`: a host of a Ray cluster is killed, another one is drained, while people hold in rooms.

Several raylets run on this machine, with rooms, fronts and people as real processes. Figures are of this one machine: they
share its processors.
"""

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
from cyclopts import Parameter

from cogrip.cli.terminal.output import Json, make_console, write_json
from cogrip.cli.terminal.problem import Problem, within

from tests.bench.losses import QUIET_S, Loss, commands, let_go, lose, result_of, table_of
from tests.live.held_arms import Spoken
from tests.live.raylets import descendants, kill, raylet_of, raylets
from tests.live.test_cluster import Fronts, rooms_of

BACK_S = 5.0  # within which everybody is asked to have resumed


def bench_cluster(
    *,
    hosts: int = 3,
    rooms: int = 4,
    quiet: Annotated[float, Parameter(name="--seconds")] = QUIET_S,
    checkpoints: Literal["folder", "memory"] = "folder",
    json: Json = None,
) -> int:
    """Kill a host of a cluster with -9, then drain another one, while a person holds in each room.

    Exit code 0 if everybody is back in 5 s, no force steps by more than 0.5 N, and the other rooms' p99 is unchanged.

    Parameters
    ----------
    hosts
        How many raylets, the head included.
    rooms
        How many, with a person each.
    quiet
        How long the rooms are measured before and after each loss [s].
    checkpoints
        Where those are: in the shared folder, or in the memory of two hosts.
    """
    within("--hosts", hosts, 2, 8)
    within("--rooms", rooms, 2, 16)
    within("--seconds", quiet, 2, 60)
    if sys.platform != "linux":
        raise Problem("a cluster needs Linux")
    console = make_console(stderr=json == "-")
    try:
        import ray  # noqa: F401
    except ImportError:
        raise Problem("this needs the package ray: python3 dev.py setup") from None
    with commands() as (start, base), raylets(hosts - 1) as cluster:
        try:
            losses, people = _lose_hosts(cluster, start, base, rooms, quiet, checkpoints)
            results = [result_of(loss, people, base / "rooms", quiet) for loss in losses]
        except AssertionError as error:
            raise Problem(f"the session did not come to its end: {error}") from None
    console.print(table_of("host", results))
    well = all(result.well for result in results)
    if json is not None:
        write_json({"losses": msgspec.to_builtins(results), "reached": well}, json)
    return 0 if well else 1


def _lose_hosts(
    cluster: Any, start: Callable[..., Spoken], base: Path, rooms: int, quiet_s: float, checkpoints: str
) -> tuple[list[Loss], dict[str, Spoken]]:
    """Kill a host that has rooms, and drain another one; then everybody leaves."""
    names = tuple(f"room{number}" for number in range(rooms))
    fronts = Fronts(start, base, cluster.address, names, "--checkpoints", checkpoints)
    people = {name: fronts.join(number % 2, name) for number, name in enumerate(names)}
    doomed = max(cluster.worker_nodes, key=lambda node: len(rooms_of(node)))
    losses = [lose("kill -9", lambda: kill(descendants(raylet_of(doomed))), people, quiet_s, BACK_S)]
    drained = max(
        (node for node in cluster.list_all_nodes() if node is not doomed), key=lambda node: len(rooms_of(node))
    )
    losses.append(lose("drain", lambda: fronts.ask(1, "drain", drained.node_id[:12]), people, quiet_s, BACK_S))
    let_go(people)
    fronts.end()
    return losses, people
