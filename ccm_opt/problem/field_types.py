"""What in a problem has the wrong type altogether, before its values are looked at."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

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


@dataclass(frozen=True)
class PartTypes:
    """What the parts of a problem are.

    Attributes:
        parts: of which type each part is, by its dotted name.
        numbers: parts that are numbers.
        entries: of which type all entries of a part are.
    """

    parts: Mapping[str, tuple[type, ...]]
    numbers: tuple[str, ...]
    entries: Mapping[str, type]


COMMON_PARTS: Mapping[str, tuple[type, ...]] = {
    "name": (str,),
    "limits": (Limits,),
    "description": (str,),
    "tolerances": (Tolerances,),
    "stops": (tuple,),
    "planner": (PlannerOptions,),
    "simulation": (SimulationOptions,),
    "verification": (VerificationOptions,),
    "source": (str,),
}
"""Parts that a problem in the plane and one in space have in common."""
COMMON_NUMBERS = (
    *("joint_error", "workspace.clearance"),
    *(f"arm.{name}" for name in ("links", "link_length", "radius", "joint_limit", "base_limit")),
    *("arm.mount_length", "arm.payload", "tolerances.position", "tolerances.heading"),
    *("planner.time_limit", "planner.effort_share", "simulation.step", "simulation.bandwidth"),
)
"""Numbers that they have in common."""
IN_THE_PLANE = PartTypes(
    parts={
        **COMMON_PARTS,
        "workspace": (Workspace,),
        "arm": (Arm,),
        "start": (JointPose, CurvePose),
        "goal": (TipGoal, JointPose, CurvePose),
        "workspace.boundary": (shapely.Polygon,),
        "workspace.obstacles": (tuple,),
        "arm.feed": (Feed, type(None)),
        "planner.weights": (Weights,),
    },
    numbers=(*COMMON_NUMBERS, "arm.base_heading"),
    entries={"stops": Stop, "workspace.obstacles": Obstacle},
)
"""Of a ``Problem``."""


def wrong_types(problem: object, types: PartTypes = IN_THE_PLANE) -> Iterator[str]:
    """A line for every part of a problem that is of another type than it has to be."""
    broken: set[str] = set()
    for name, kinds in types.parts.items():
        value = _part(problem, name, broken)
        if value is not _NOTHING and not isinstance(value, kinds):
            broken.add(name)
            yield f"{name} must be a {' or '.join(kind.__name__ for kind in kinds)}, got {in_words(value)}"
    for name in types.numbers:
        value = _part(problem, name, broken)
        if value is not _NOTHING and not is_number(value):
            yield f"{name} must be a finite number, got {in_words(value)}"
    for name, kind in types.entries.items():
        entries = _part(problem, name, broken)
        for k, entry in enumerate(entries if isinstance(entries, tuple) else ()):
            if not isinstance(entry, kind):
                yield f"{name}[{k}] must be a {kind.__name__}, got {in_words(entry)}"


_NOTHING = object()
"""Stands for a part of something that is broken itself."""


def _part(problem: object, name: str, broken: set[str]) -> object:
    """A part of a problem by its dotted name."""
    value: object = problem
    at = ""
    for key in name.split("."):
        if at in broken:
            return _NOTHING
        value = getattr(value, key)
        at = f"{at}.{key}" if at else key
    return value
