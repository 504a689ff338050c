"""What URDF and MJCF both say about the arm: its revolutes in order, and how numbers are written."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from ccm_opt.jointed.arm import Arm, Axes
from ccm_opt.jointed.frames import joint_names

FEED = "feed"
"""Name of the prismatic joint of the feed axis, the first of all joints where there is one."""
Axis = tuple[float, float, float]
_X, _Y, _Z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
REVOLUTE_AXES: dict[Axes, tuple[Axis, Axis, Axis]] = {"zyx": (_Z, _Y, _X), "zyz": (_Z, _Y, _Z)}


@dataclass(frozen=True)
class Revolute:
    """One revolute of a ball joint.

    Attributes:
        name: as in ``joint_names``.
        ball: number of its ball, counted from 1.
        axis: unit vector in its own frame, x along the link.
        limit: bound on its absolute angle [rad]: the bend limit for a bend, half a turn out of the plane.
        starts_ball: whether it is the first of its ball.
        carries_link: whether it is the last of its ball, the one that moves the link.
        rotor_inertia: of its drive [kg m²].
        friction: viscous [N m s/rad].
    """

    name: str
    ball: int
    axis: Axis
    limit: float
    starts_ball: bool
    carries_link: bool
    rotor_inertia: float
    friction: float


def revolutes(arm: Arm) -> Iterator[Revolute]:
    """All revolutes from the base outward."""
    axes, bends = REVOLUTE_AXES[arm.axes], arm.bend_limits
    rotors, friction = (np.broadcast_to(value, (3 * arm.links,)) for value in (arm.rotor_inertia, arm.friction))
    for index, name in enumerate(joint_names(arm)):
        ball, place = divmod(index, 3)
        limit = float(bends[ball]) if place == 1 else float(np.pi)
        drive = float(rotors[index]), float(friction[index])
        yield Revolute(name, ball + 1, axes[place], limit, place == 0, place == 2, *drive)


def visual_radius(arm: Arm) -> float:
    """Radius to draw links with [m]: the arm's own, or a thin line for an arm without thickness."""
    return arm.radius if arm.radius > 0.0 else 0.02 * arm.link_length


def number(value: float) -> str:
    """A number that reads back as itself."""
    return repr(float(value))


def numbers(values: Iterable[float]) -> str:
    """Numbers separated by blanks."""
    return " ".join(number(value) for value in values)
