"""The drives of an arm as the verifier reads them.

In the plane the bend of a ball is minus its second revolute. In space its two bends are its first and second revolute.
The others stay at zero.
"""

from collections.abc import Callable, Sequence
from typing import TypeAlias

import numpy as np

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.problem import Problem
from ccm_opt.problem.solution import Check, JointStates
from ccm_opt.robot.coordinates import Coordinates
from ccm_opt.robot.frames import joint_names

Efforts: TypeAlias = tuple[FloatArray, FloatArray]
"""Torques of all revolutes, shape (T, 3 * links) [N m], and the force that carries the base, shape (T,) [N]."""


def bends_a_ball(coordinates: Coordinates) -> int:
    """Return how many bends a ball joint has: one in the plane, two in space."""
    return coordinates.joints // (coordinates.revolutes // 3)


def bend_revolutes(coordinates: Coordinates) -> IntArray:
    """Number of the revolute of every bend, shape (bends,)."""
    first = np.arange(0, coordinates.revolutes, 3)
    if bends_a_ball(coordinates) == 1:
        return first + 1
    return np.stack((first, first + 1), axis=1).ravel()


def as_revolutes(coordinates: Coordinates, bends: FloatArray) -> FloatArray:
    """Return the revolutes of bends (T, bends), shape (T, 3 * links)."""
    values = np.zeros((len(bends), coordinates.revolutes))
    # In the plane a bend is counter-clockwise in x-z, which is a negative turn about y.
    values[:, bend_revolutes(coordinates)] = -bends if bends_a_ball(coordinates) == 1 else bends
    return values


def describe_bend_joint(coordinates: Coordinates, number: int) -> str:
    """Return the joint that a bend belongs to, in words."""
    each = bends_a_ball(coordinates)
    return f"joint {number + 1}" if each == 1 else f"joint {number // each + 1} {'ab'[number % each]}"


def describe_bend_joints(coordinates: Coordinates) -> tuple[str, ...]:
    """Return the joints that all bends belong to, in words."""
    return tuple(describe_bend_joint(coordinates, number) for number in range(coordinates.joints))


def describe_revolute_joints(names: Sequence[str]) -> tuple[str, ...]:
    """Return the revolutes with names in words, the joints counted from 1."""
    return tuple(f"joint {number // 3 + 1} ({name})" for number, name in enumerate(names))


def sample_words(time: FloatArray, names: Sequence[str] = ()) -> Callable[..., str]:
    """What says of the numbers of a time, and of a column with a name where there are any, where and when it is."""
    return lambda k, *column: " at ".join((*(names[j] for j in column), f"t = {time[k]:.4f} s"))


def check_worst(
    name: str,
    unit: str,
    values: FloatArray,
    allowed: FloatArray | float,
    where: Callable[..., str],
    tolerance: float = 0.0,
) -> Check:
    """Check values by that which takes the greatest share of what is allowed.

    Args:
        name: of the check.
        unit: of the values.
        values: of any shape, and sign.
        allowed: of that shape, or one that is broadcast to it; positive.
        where: says of the numbers of a value where it is.
        tolerance: share by which the values may pass what is allowed.
    """
    sizes = np.abs(values)
    bounds = np.broadcast_to(allowed, sizes.shape)
    # Shares are compared, for the drives need not have the same limits.
    worst = np.unravel_index(np.argmax(sizes / bounds), sizes.shape)
    size, bound = float(sizes[worst]), float(bounds[worst])
    return Check(name, size, bound, unit, where(*map(int, worst)), passed=size <= bound * (1.0 + tolerance))


def check_names(problem: Problem, joints: JointStates) -> Check:
    """Check that the drives are called as those of the arm."""
    expected = joint_names(problem.arm)
    # Names of another length are compared as far as both go; what is left over counts as wrong below.
    differing = [ours for theirs, ours in zip(joints.names, expected, strict=False) if theirs != ours]
    wrong = len(differing) + abs(len(joints.names) - len(expected))
    where = f"expected {differing[0]!r}" if differing else f"{len(joints.names)} names for {len(expected)} revolutes"
    return Check("joint names", float(wrong), 0.0, "names", where, passed=wrong == 0)
