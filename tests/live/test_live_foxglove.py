"""The Foxglove protocol as its users have it: a server, somebody who pulls, and `cogrip view --foxglove`. Real processes."""

import signal

import pytest

from tests.live.held_arms import DEMO
from tests.view.event_loop import run as run_loop
from tests.view.foxglove_client import connected

TOPICS = ("/scene", "/forces", "/tf", "/object", "/anna/state")
FRAMES = 32


@pytest.mark.parametrize("subprotocol", ["foxglove.sdk.v1", "foxglove.websocket.v1"])
def test_an_independent_client_receives_scene_and_plots_live(run, serve, tmp_path, subprotocol: str) -> None:
    _, port = serve(DEMO)
    place = f"127.0.0.1:{port}"
    anna = run(
        "join", place, "--name", "anna", "--device", "sim:phantom?hand=reach&amplitude_m=0.02", "--runs", tmp_path
    )
    anna.hear("anna holds cube")
    view = run("view", place, "--foxglove", "--no-browser")
    address = view.hear(r"Foxglove, Lichtblick: (ws://\S+)")[1]

    async def follow() -> dict[str, list]:
        async with connected(address, subprotocol) as client:
            assert client.info["capabilities"] == ["time"], "a live session is not played back"
            while {channel["topic"] for channel in client.channels.values()} < set(TOPICS):
                await client.take()
            await client.subscribe(*TOPICS)
            while len(client.data.get("/anna/state", [])) < FRAMES or set(client.data) < set(TOPICS):
                await client.take()
            return client.data

    data = run_loop(follow())
    pulled = [message["force_n"]["x"] for _, message in data["/anna/state"]]
    assert {message["state"] for _, message in data["/anna/state"]} == {"live"}
    assert any(pulled), "she pulls, so a force is told"
    objects = {time_ns: message["position_m"]["x"] for time_ns, message in data["/object"]}
    assert len(set(objects.values())) > FRAMES / 2, "and the object moves"
    for time_ns, message in data["/tf"]:
        places = {each["child_frame_id"]: each["translation"]["x"] for each in message["transforms"]}
        if time_ns in objects:
            assert places["demo/object"] == pytest.approx(objects[time_ns], abs=1e-7)
    view.signal(signal.SIGINT)
    assert view.end() == 0, view.said
