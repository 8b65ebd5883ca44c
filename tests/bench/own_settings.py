"""Settings that a benchmark gives each of its sessions itself, so that no `--set` may."""

from collections.abc import Mapping
from typing import Any

from cogrip.cli.terminal.problem import BadInput


def refuse_own(bench: str, changes: Mapping[str, Any], own: Mapping[str, str]) -> None:
    """Raises BadInput for a key of `own`, one in such a section, or a whole section with such a key in it.

    changes: what `--set` asks for, by path; own: paths of settings, and what to do instead.
    """
    for key, value in changes.items():
        for path, cure in own.items():
            if f"{key}.".startswith(f"{path}.") or path.startswith(f"{key}."):
                raise BadInput(f"--set {key}={value}: {bench} sets {path} itself in each session; {cure}")
