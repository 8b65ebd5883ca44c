"""Build hook of a wheel of one platform, with the compiled form in it (`HATCH_BUILD_HOOKS_ENABLE=1`; docs/platforms.md).

Without it, what is built is the wheel for every platform, which has the sources alone.
"""

import sys
import tempfile
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

sys.path.insert(0, str(Path(__file__).parent))  # a build has the folder of the project on no path
import compiling


class CompiledForm(BuildHookInterface[Any]):
    """Compiles into a folder for the time of a build, which puts it into the wheel."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        if version == "editable":
            return  # a checkout has its own
        self._folder = tempfile.TemporaryDirectory()
        compiling.compile_into(Path(self._folder.name))
        build_data.update(pure_python=False, infer_tag=True)
        build_data["force_include"][self._folder.name] = "cogrip/machine/compiled/built"

    def finalize(self, version: str, build_data: dict[str, Any], artifact_path: str) -> None:
        if version != "editable":
            self._folder.cleanup()
