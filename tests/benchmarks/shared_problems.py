"""The problem files in ``problems/`` with another number of links, the same length and the same mass."""

import tomllib
from copy import deepcopy
from pathlib import Path
from typing import Any

from ccm_opt.io.reading import problem_from_mapping
from ccm_opt.problem import Problem

FOLDER = Path(__file__).parents[2] / "problems"
NAMES = tuple(sorted(path.stem for path in FOLDER.glob("*.toml") if not path.stem.startswith("feed-")))
DEFAULT_MASS = 0.1
"""Mass of a link when the file gives none [kg]."""


def problem_data(name: str) -> dict[str, Any]:
    """The tables of a problem file."""
    return tomllib.loads((FOLDER / f"{name}.toml").read_text(encoding="utf-8"))


def with_links(data: dict[str, Any], links: int) -> Problem:
    """The problem with another number of links; its start is mapped, or shaped, anew."""
    data = deepcopy(data)
    arm = data["arm"]
    share = arm["links"] / links
    arm.update(
        links=links, link_length=arm["link_length"] * share, link_mass=arm.get("link_mass", DEFAULT_MASS) * share
    )
    return problem_from_mapping(data, data["name"])
