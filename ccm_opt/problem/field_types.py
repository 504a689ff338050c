"""Type checks of the attributes of a problem, and the report on an imported drawing."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import shapely

from ccm_opt.core.arguments import in_words, is_number
from ccm_opt.core.length_words import file_length
from ccm_opt.problem.options import PlannerOptions, SimulationOptions, VerificationOptions, Weights
from ccm_opt.problem.poses import Coverage, JointPose, Stop, TipGoal, Tolerances
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.base_axes import Feed
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
    "coverage": (Coverage, type(None)),
    "source": (str,),
    "workspace.boundary": (shapely.Polygon,),
    "workspace.obstacles": (tuple,),
    "arm.feed": (Feed, type(None)),
    "planner.weights": (Weights,),
}
"""Allowed types of a problem's attributes, by dotted name."""
_NUMBERS = (
    *("joint_error", "pause", "workspace.clearance"),
    *(f"arm.{name}" for name in ("links", "link_length", "radius", "joint_limit", "base_limit")),
    *("arm.mount_length", "arm.payload", "arm.base_heading", "tolerances.position", "tolerances.heading"),
    *("planner.time_limit", "planner.effort_share", "simulation.step", "simulation.bandwidth"),
)
"""Dotted names of a problem's attributes that must be finite numbers."""
_ENTRIES: Mapping[str, type] = {"stops": Stop, "workspace.obstacles": Obstacle}
"""Required type of the entries of a problem's tuple attributes, by dotted name."""


def wrong_types(problem: object) -> Iterator[str]:
    """Yield a sentence for every attribute of a problem that has a wrong type."""
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
"""Placeholder for an attribute whose parent already has a wrong type, so that one defect is not reported twice."""


def _part(problem: object, name: str, broken: set[str]) -> object:
    """Return an attribute of a problem by its dotted name.

    The result is ``_NOTHING`` if a parent attribute is in ``broken``, the dotted names found to have wrong types.
    """
    value: object = problem
    at = ""
    for key in name.split("."):
        if at in broken:
            return _NOTHING
        value = getattr(value, key)
        at = f"{at}.{key}" if at else key
    return value


ODD_RATIO = 100.0
"""Ratio between the sizes of drawing and arm from which a wrong scale is suspected. Derived: millimetres mistaken for
metres give a factor of a thousand, and no drawing that fits its arm is ten times smaller or larger than the arm."""


def odd_times(ratio: float) -> str | None:
    """Return a phrase such as "1e+03 times larger" for an implausible ratio of sizes; None for a plausible one.

    Args:
        ratio: size of a drawing or mesh divided by the length of the arm.
    """
    if ODD_RATIO**-1 < ratio < ODD_RATIO:
        return None
    larger = ratio > 1.0
    return f"{ratio if larger else 1.0 / max(ratio, 1e-300):.3g} times {'larger' if larger else 'smaller'}"


@dataclass(frozen=True)
class LeftOut:
    """An element of a drawing that was not imported as an obstacle.

    Attributes:
        what: kind of the element, with its name if it has one, for example ``text 'title'``.
        reason: why the element was left out, for example ``text is not an obstacle``.
    """

    what: str
    reason: str


@dataclass(frozen=True)
class ImportedDrawing:
    """Report on the import of obstacles from a drawing.

    Attributes:
        file: name of the drawing's file.
        obstacles: number of obstacles imported.
        box: bounding box of the obstacles in the workspace: (x low, y low, x high, y high) [m].
        layers: names of layers, or of outermost named groups, with the number of shapes on each; empty if the
            drawing has none.
        left_out: elements that were not imported, in the order of the drawing.
        unit: unit of length stated in the drawing, for information only, since the scale in the problem file applies;
            empty if the drawing states none.
        metres: length of one unit of the drawing as imported [m].
        stated_metres: length of one unit according to the physical size stated in the drawing [m]; None if the
            drawing states none.
    """

    file: str
    obstacles: int
    box: tuple[float, float, float, float]
    layers: tuple[tuple[str, int], ...] = ()
    left_out: tuple[LeftOut, ...] = ()
    unit: str = ""
    metres: float = 1.0
    stated_metres: float | None = None

    @property
    def extent(self) -> float:
        """Longer side of the bounding box of the imported obstacles [m]."""
        xmin, ymin, xmax, ymax = self.box
        return max(xmax - xmin, ymax - ymin)

    def odd_size(self, arm_length: float) -> str | None:
        """Return a warning if the drawing's size, compared with the arm's length, suggests a wrong scale; else None.

        Args:
            arm_length: length of the arm [m].
        """
        if (times := odd_times(self.extent / arm_length)) is None:
            return None
        return (
            f"the drawing {self.file} spans {file_length(self.extent)}, {times} than the arm's "
            f"{file_length(arm_length)}; check workspace.scale, the length of one unit of the drawing (0.001 for a "
            "drawing in millimetres and a problem file in metres)"
        )


@dataclass(frozen=True)
class ImportedJoint:
    """A joint of the URDF file from which an arm was read.

    Attributes:
        name: its name in that file.
        drive: index of its drive among the revolutes of the arm, three a joint, and the axes of the base after them.
        sense: +1 if both turn or move the same way, −1 if not.
        held: whether it stays at zero, since the arm has no bend about its axis.
    """

    name: str
    drive: int
    sense: float
    held: bool


@dataclass(frozen=True)
class ImportedArm:
    """Report on the reading of an arm from a URDF file.

    Attributes:
        file: name of the file.
        joints: its joints from the base outward.
        notes: what was left out, simplified or made larger, in words for the user.
    """

    file: str
    joints: tuple[ImportedJoint, ...]
    notes: tuple[str, ...]
