"""Versions of what a result depends on."""

import platform
from collections.abc import Mapping
from functools import cache
from importlib.metadata import version

PACKAGES = ("ccm-opt", "casadi", "daqp", "numpy", "piqp", "scipy", "shapely", "toppra")
"""Packages that a result depends on."""


@cache
def versions() -> Mapping[str, str]:
    """Versions of Python and of the packages a result depends on."""
    return {"python": platform.python_version(), **{name: version(name) for name in PACKAGES}}
