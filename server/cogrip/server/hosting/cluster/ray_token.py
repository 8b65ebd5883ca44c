"""Trial of a Ray cluster: somebody without its token is let in, or is not.

Whoever runs a job there runs programs as the server's user, and reads its key. The settings of this process say nothing of
what the cluster does: a process that has no token asks it.
"""

import os
import subprocess
import sys

ASKED = 77  # exit code of a probe whose cluster asks for a token
PROBE_S = 30.0
PROBE = f"""
import sys
from ray._raylet import GcsClient
from ray.exceptions import AuthenticationError
try:
    GcsClient(address=sys.argv[1]).internal_kv_keys(b"", namespace=None, timeout=5)
except AuthenticationError:
    sys.exit({ASKED})
"""


def asks_for_token(address: str) -> bool:
    """Return whether the cluster at HOST:PORT of its head refuses whoever has no token; False where that is not known."""
    without = {name: value for name, value in os.environ.items() if not name.startswith("RAY_AUTH_")}
    try:
        tried = subprocess.run(
            [sys.executable, "-P", "-c", PROBE, address], env={**without, "RAY_AUTH_MODE": "disabled"},
            stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, timeout=PROBE_S, check=False,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        return False
    return tried.returncode == ASKED
