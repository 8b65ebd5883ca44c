"""A new recording read by the library that Foxglove itself reads MCAP files with, `@mcap/core` for Node."""

import json
import os
import shutil
import subprocess
from pathlib import Path

import pytest

from cogrip.protocol.recording.derived import DERIVED

from tests.foxglove_schemas import PUBLISHED, check_schema, check_value
from tests.view.recorded_runs import recorded_run

SCRIPT = Path(__file__).with_name("read_recording.mjs")
PACKAGES = ("@mcap/core@2", "zstd-codec@0.1.5")
INSTALL_LIMIT_S = 120.0


@pytest.fixture
def node_folder(tmp_path: Path) -> Path:
    """A folder with the packages; where there is no Node, or no registry can be reached, the test is skipped."""
    npm = shutil.which("npm")
    if npm is None or shutil.which("node") is None:
        pytest.skip("Node and npm are not here")
    command = [npm, "install", "--no-audit", "--no-fund", "--ignore-scripts", "--prefix", str(tmp_path), *PACKAGES]
    environment = {**os.environ, "npm_config_fetch_retries": "0"}
    try:
        done = subprocess.run(
            command, env=environment, cwd=tmp_path, capture_output=True, text=True, timeout=INSTALL_LIMIT_S, check=False
        )
    except subprocess.TimeoutExpired:
        pytest.skip("npm's registry does not answer")
    if done.returncode:
        pytest.skip(f"npm cannot install {' '.join(PACKAGES)}: {done.stderr.strip()[-200:]}")
    return tmp_path


def test_mcap_core_finds_scene_and_transforms_with_the_published_schemas(node_folder: Path) -> None:
    run = recorded_run(node_folder / "run", 2.0)
    script = Path(shutil.copy(SCRIPT, node_folder))
    topics = [f"/room/demo/{kind}" for kind in DERIVED]
    done = subprocess.run(
        ["node", str(script), str(run / "server.mcap"), *topics], capture_output=True, text=True, check=True
    )
    found = json.loads(done.stdout)
    assert set(found) == set(topics)
    for topic, channel in found.items():
        assert (channel["encoding"], channel["schemaEncoding"]) == ("json", "jsonschema")
        assert channel["schemaName"] == DERIVED[topic.rpartition("/")[2]]
        check_schema(channel["schema"], PUBLISHED[channel["schemaName"]])
        for _, message in channel["messages"]:
            check_value(message, PUBLISHED[channel["schemaName"]])
    assert len(found["/room/demo/tf"]["messages"]) == 64
    assert len(found["/room/demo/scene"]["messages"]) == 2
