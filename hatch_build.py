"""Hatch's hook: compiles the package's C when a wheel is built, also in ``pip install``, where there is a compiler.

Without one the wheel is made as ever, for any machine; what it needs is then compiled at the first use, or done by
numpy.
"""

import sys
import sysconfig
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface


class CompilingHook(BuildHookInterface):  # type: ignore[type-arg,misc]  # hatchling may not be installed for mypy
    """Puts the compiled libraries into the wheel."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Compile into the source tree, from where editable installs load too."""
        del version
        sys.path.insert(0, self.root)
        # The package under the root, whose own dependencies are those that pyproject.toml asks for at building.
        from ccm_opt.dynamics.runtime.compiled_library import every_recipe  # noqa: PLC0415
        from ccm_opt.ground.library_cache import PREBUILT  # noqa: PLC0415
        from ccm_opt.ground.prebuilding import prebuild, recipes_of_sources  # noqa: PLC0415

        try:
            made = prebuild((*recipes_of_sources(), *every_recipe()), PREBUILT)
        except OSError as error:
            self.app.display_warning(f"nothing is compiled: {error}")
            return
        # The libraries are plain C for one system, called by ctypes: any Python can load them.
        system = sysconfig.get_platform().replace("-", "_").replace(".", "_")
        build_data["tag"] = f"py3-none-{system}"
        build_data["pure_python"] = False
        root = Path(self.root)
        build_data["artifacts"].extend(f"/{path.relative_to(root).as_posix()}" for path in made)
