"""Types of the fields of problems."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import shapely

from ccm_opt.core.arguments import in_words, is_number
from ccm_opt.core.length_words import file_length
from ccm_opt.problem.options import PlannerOptions, SimulationOptions, VerificationOptions, Weights
from ccm_opt.problem.poses import JointPose, Stop, TipGoal, Tolerances
from ccm_opt.robot.arm import Arm, Feed
from ccm_opt.robot.coordinates import Limits
from ccm_opt.scene.workspace import Obstacle, Workspace

_PARTS: Mapping[str, tuple[type, ...]] = {
    "name": (str,),
    "workspace": (Workspace,),
    "arm": (Arm,),
    "limits": (Limits,),
    "start": (JointPose,),
    "goal": (TipGoal, JointPose),
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
"""Types of the parts of a problem, by their dotted names."""
_NUMBERS = (
    *("joint_error", "workspace.clearance"),
    *(f"arm.{name}" for name in ("links", "link_length", "radius", "joint_limit", "base_limit")),
    *("arm.mount_length", "arm.payload", "arm.base_heading", "tolerances.position", "tolerances.heading"),
    *("planner.time_limit", "planner.effort_share", "simulation.step", "simulation.bandwidth"),
)
"""Its parts that are numbers."""
_ENTRIES: Mapping[str, type] = {"stops": Stop, "workspace.obstacles": Obstacle}
"""Types of all entries of a part."""


def wrong_types(problem: object) -> Iterator[str]:
    """Yield a line for every part of a problem that is of another type than it has to be."""
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
    for name, kind in _ENTRIES.items():
        entries = _part(problem, name, broken)
        for k, entry in enumerate(entries if isinstance(entries, tuple) else ()):
            if not isinstance(entry, kind):
                yield f"{name}[{k}] must be a {kind.__name__}, got {in_words(entry)}"


_NOTHING = object()
"""Stands for a part of something that is broken itself."""


def _part(problem: object, name: str, broken: set[str]) -> object:
    """Return a part of a problem by its dotted name."""
    value: object = problem
    at = ""
    for key in name.split("."):
        if at in broken:
            return _NOTHING
        value = getattr(value, key)
        at = f"{at}.{key}" if at else key
    return value


ODD_RATIO = 100.0
"""Drawings this much larger or smaller than the arm are taken for mistakes of scale. Derived: millimetres in place of
metres are a factor of a thousand, and of drawings that fit their arm none is ten times smaller or larger than it."""


def odd_times(ratio: float) -> str | None:
    """Return how many times larger or smaller than the arm something is, where its scale must be wrong; else None."""
    if ODD_RATIO**-1 < ratio < ODD_RATIO:
        return None
    larger = ratio > 1.0
    return f"{ratio if larger else 1.0 / max(ratio, 1e-300):.3g} times {'larger' if larger else 'smaller'}"


@dataclass(frozen=True)
class LeftOut:
    """Something in a drawing that became no obstacle.

    Attributes:
        what: its kind and, where it has one, its name, for example ``text 'title'``.
        reason: why, for example ``texts are no obstacles``.
    """

    what: str
    reason: str


@dataclass(frozen=True)
class ImportedDrawing:
    """What was read from a drawing.

    Attributes:
        file: its name.
        obstacles: how many obstacles it gave.
        box: least x and y and greatest x and y of them all, as they are placed in the workspace, shape (4,) [m].
        layers: names of layers, or of the outermost named groups, with the number of obstacles on each; empty where
            the drawing has none.
        left_out: everything that became no obstacle, in the order of the drawing.
        unit: of length that the drawing names, which counts for nothing beside the scale; empty where it names none.
    """

    file: str
    obstacles: int
    box: tuple[float, float, float, float]
    layers: tuple[tuple[str, int], ...] = ()
    left_out: tuple[LeftOut, ...] = ()
    unit: str = ""

    @property
    def extent(self) -> float:
        """The longer side of the box [m]."""
        xmin, ymin, xmax, ymax = self.box
        return max(xmax - xmin, ymax - ymin)

    def odd_size(self, arm_length: float) -> str | None:
        """Return a warning where the drawing is so much larger or smaller than the arm that its scale must be wrong.

        Args:
            arm_length: length of the arm [m].
        """
        if (times := odd_times(self.extent / arm_length)) is None:
            return None
        return (
            f"the obstacles of {self.file} are {times} than the arm is long: {file_length(self.extent)} against "
            f"{file_length(arm_length)}; is workspace.scale the length of one unit of the drawing? (0.001 "
            "where the drawing is in millimetres and the file in metres)"
        )
