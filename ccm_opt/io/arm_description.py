"""What URDF and MJCF both say about the arm: its revolutes in order, and how numbers are written."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.robot.arm import Arm, Axes
from ccm_opt.robot.frames import joint_names

FEED = "feed"
"""Name of the prismatic joint of the feed axis, the first of all joints where there is one."""
Axis = tuple[float, float, float]
_UPRIGHT = 1e-12
"""A line of length 1 whose level part is shorter than this stands upright, to rounding."""
_X = (1.0, 0.0, 0.0)
_Y = (0.0, 1.0, 0.0)
_Z = (0.0, 0.0, 1.0)
REVOLUTE_AXES: dict[Axes, tuple[Axis, Axis, Axis]] = {"zyx": (_Z, _Y, _X), "zyz": (_Z, _Y, _Z)}


@dataclass(frozen=True)
class Revolute:
    """One revolute of a ball joint.

    Attributes:
        name: as in ``joint_names``.
        index: its place among all revolutes of the arm.
        ball: number of its ball, counted from 1.
        axis: unit vector in its own frame, x along the link.
        limit: bound on its absolute angle [rad]: the bend limit for a bend, half a turn out of the plane.
        starts_ball: whether it is the first of its ball.
        carries_link: whether it is the last of its ball, the one that moves the link.
        rotor_inertia: of its drive [kg m²].
        friction: viscous [N m s/rad].
    """

    name: str
    index: int
    ball: int
    axis: Axis
    limit: float
    starts_ball: bool
    carries_link: bool
    rotor_inertia: float
    friction: float


def revolutes(arm: Arm, *, bends_only: bool = False) -> Iterator[Revolute]:
    """The revolutes from the base outward.

    Args:
        arm: the arm.
        bends_only: whether only those that bend the arm are wanted: one a ball of an arm in the plane, which then stays
            there, and two of one in space, which then does not roll.
    """
    axes = REVOLUTE_AXES[arm.axes]
    coordinates = arm.coordinates
    bends = dict(zip(coordinates.drives[: coordinates.joints], arm.bend_limits, strict=True))
    first = coordinates.drives[0]
    last = coordinates.drives[coordinates.joints - 1] % 3
    rotors = np.broadcast_to(arm.rotor_inertia, (3 * arm.links,))
    friction = np.broadcast_to(arm.friction, (3 * arm.links,))
    for index, name in enumerate(joint_names(arm)):
        ball, place = divmod(index, 3)
        if bends_only and index not in bends:
            continue
        yield Revolute(
            name=name,
            index=index,
            ball=ball + 1,
            axis=axes[place],
            limit=float(bends.get(index, np.pi)),
            starts_ball=place == (first if bends_only else 0),
            carries_link=place == (last if bends_only else 2),
            rotor_inertia=float(rotors[index]),
            friction=float(friction[index]),
        )


def visual_radius(arm: Arm) -> float:
    """Radius to draw links with [m]: the arm's own, or a thin line for an arm without thickness."""
    return arm.radius if arm.radius > 0.0 else 0.02 * arm.link_length


def checked_share(arm: Arm, k: int) -> float:
    """Where on link k the part begins that may touch nothing, as a share of its length; 1: all is mount."""
    return float(np.clip(arm.mount_length / arm.link_length - k, 0.0, 1.0))


def roll_pitch_yaw(turn: FloatArray) -> tuple[float, float, float]:
    """Angles about the fixed x, then y, then z that a rotation, shape (3, 3), is made of [rad]."""
    level = float(np.hypot(turn[0, 0], turn[1, 0]))
    pitch = float(np.arctan2(-turn[2, 0], level))
    if level < _UPRIGHT:
        # With x straight up or down, the first and the last turn are about one line: all of it is the first.
        return float(np.arctan2(-turn[1, 2], turn[1, 1])), pitch, 0.0
    return float(np.arctan2(turn[2, 1], turn[2, 2])), pitch, float(np.arctan2(turn[1, 0], turn[0, 0]))


def number(value: float) -> str:
    """A number that reads back as itself."""
    return repr(float(value))


def numbers(values: Iterable[float]) -> str:
    """Numbers separated by blanks."""
    return " ".join(number(value) for value in values)
