"""What in a problem has the wrong type altogether, before its values are looked at."""

from collections.abc import Iterator
from typing import TYPE_CHECKING

import shapely

from ccm_opt.freespace.obstacle import Obstacle
from ccm_opt.freespace.workspace import Workspace
from ccm_opt.ground.arguments import is_number
from ccm_opt.ground.expected import in_words
from ccm_opt.jointed.arm import Arm
from ccm_opt.jointed.drive_limits import Limits
from ccm_opt.jointed.link_chain import Feed
from ccm_opt.problem.options import PlannerOptions, SimulationOptions, VerificationOptions, Weights
from ccm_opt.problem.poses import CurvePose, JointPose, Stop, TipGoal, Tolerances

if TYPE_CHECKING:
    from ccm_opt.problem.definition import Problem

_PARTS: dict[str, tuple[type, ...]] = {
    "name": (str,),
    "workspace": (Workspace,),
    "arm": (Arm,),
    "limits": (Limits,),
    "start": (JointPose, CurvePose),
    "goal": (TipGoal, JointPose, CurvePose),
    "description": (str,),
    "tolerances": (Tolerances,),
    "stops": (tuple,),
    "planner": (PlannerOptions,),
    "simulation": (SimulationOptions,),
    "verification": (VerificationOptions,),
    "source": (str,),
    "workspace.boundary": (shapely.Polygon,),
    "workspace.obstacles": (tuple,),
    "arm.feed": (Feed, type(None)),
    "planner.weights": (Weights,),
}
"""Of which type each part is."""
_NUMBERS = (
    *("joint_error", "workspace.clearance"),
    *(f"arm.{name}" for name in ("links", "link_length", "radius", "base_heading", "joint_limit", "base_limit")),
    *("arm.mount_length", "arm.payload", "tolerances.position", "tolerances.heading"),
    *("planner.time_limit", "planner.effort_share", "simulation.step", "simulation.bandwidth"),
)
"""Parts that are numbers."""


def wrong_types(problem: "Problem") -> Iterator[str]:
    """A line for every part of a problem that is of another type than it has to be."""
    broken: set[str] = set()
    for name, kinds in _PARTS.items():
        value = _part(problem, name, broken)
        if value is not _NOTHING and not isinstance(value, kinds):
            broken.add(name)
            yield f"{name} must be a {' or '.join(kind.__name__ for kind in kinds)}, got {in_words(value)}"
    for name in _NUMBERS:
        value = _part(problem, name, broken)
        if value is not _NOTHING and not is_number(value):
            yield f"{name} must be a finite number, got {in_words(value)}"
    for name, kind in (("stops", Stop), ("workspace.obstacles", Obstacle)):
        entries = _part(problem, name, broken)
        for k, entry in enumerate(entries if isinstance(entries, tuple) else ()):
            if not isinstance(entry, kind):
                yield f"{name}[{k}] must be a {kind.__name__}, got {in_words(entry)}"


_NOTHING = object()
"""Stands for a part of something that is broken itself."""


def _part(problem: "Problem", name: str, broken: set[str]) -> object:
    """A part of a problem by its dotted name."""
    value: object = problem
    at = ""
    for key in name.split("."):
        if at in broken:
            return _NOTHING
        value = getattr(value, key)
        at = f"{at}.{key}" if at else key
    return value
