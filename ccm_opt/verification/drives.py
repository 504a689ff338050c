"""Relation between an arm's bends and its drives (revolute joints), and checks of values per drive.

Each ball joint consists of three revolutes. In the plane, the bend is the negative of the second revolute; in space,
the two bends are the first and second revolutes. All other revolutes are zero.
"""

from collections.abc import Callable, Sequence
from typing import TypeAlias

import numpy as np

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.problem import Problem
from ccm_opt.problem.solution import Check, JointStates
from ccm_opt.robot.arc_sections import ArcSections
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.coordinates import Coordinates, DriveLimits
from ccm_opt.robot.frames import joint_names

Efforts: TypeAlias = tuple[FloatArray, FloatArray]
"""Torques of all revolutes, shape (T, 3 * links) [N m], and efforts of the base axes, shape (T, k) [N, N m]."""


def axis_limits(problem: Problem) -> DriveLimits:
    """Return the limits of the k axes that carry the base, infinite where there is none."""
    limits, count = problem.limits, len(problem.arm.base_axes)
    if limits.axes is not None:
        return limits.axes
    of_feed = (limits.feed_velocity, limits.feed_acceleration, limits.feed_jerk, limits.feed_force)
    return DriveLimits(*(np.full(count, np.inf if bound is None else bound) for bound in of_feed))


def bends_a_ball(coordinates: Coordinates) -> int:
    """Return the number of bends per ball joint: one for a planar arm, two for an arm in space."""
    return coordinates.joints // (coordinates.revolutes // 3)


def largest_bends(arm: Arm) -> FloatArray:
    """Return the largest permitted absolute value of each bend of an arm, 0 for locked joints, shape (bends,) [rad].

    ``Arm.bend_limits`` implements the same rule; the verifier deliberately does not use it.
    """
    of_joints = np.full(arm.links, arm.joint_limit)
    of_joints[0] = arm.base_limit
    of_bends = np.repeat(of_joints, bends_a_ball(arm.coordinates))
    return of_bends if arm.proportions is None else of_bends * arm.proportions.limits


def bend_revolutes(coordinates: Coordinates) -> IntArray:
    """Return the index of the revolute that corresponds to each bend of an arm, shape (bends,)."""
    first = np.arange(0, coordinates.revolutes, 3)
    if bends_a_ball(coordinates) == 1:
        return first + 1
    return np.stack((first, first + 1), axis=1).ravel()


def as_revolutes(coordinates: Coordinates, bends: FloatArray) -> FloatArray:
    """Convert bends, shape (T, bends), to angles of all revolutes, shape (T, 3 * links); rates alike."""
    values = np.zeros((len(bends), coordinates.revolutes))
    # In the plane a bend is counter-clockwise in x-z, which is a negative turn about y.
    values[:, bend_revolutes(coordinates)] = -bends if bends_a_ball(coordinates) == 1 else bends
    return values


def of_drives(arm: Arm, torques: FloatArray) -> FloatArray:
    """Return the torques of the drives that bend an arm, shape (T, m), from those of all revolutes, (T, 3 * links).

    They are the same, unless sections bend evenly: each of their joints turns by its share of a section's bend, so that
    the section's torque is the mean of theirs. A drive of coupled joints bears what each takes, times its ratio.
    """
    if arm.coupled is not None:
        bends = torques.reshape(len(torques), arm.links, 3)[:, :, :2].reshape(len(torques), -1)
        return np.asarray(bends @ arm.coupled.ratios)
    if arm.sections is None:
        return torques
    # In the plane it is the second revolutes that bend, in the opposite sense.
    signed = torques if arm.dimension == 3 else -torques
    bends = signed.reshape(len(torques), arm.links, 3)[:, :, 3 - arm.dimension : 2]
    return np.concatenate([np.mean(bends[:, joints], axis=1) for joints in section_joints(arm.sections)], axis=1)


def section_joints(sections: ArcSections) -> list[IntArray]:
    """Return the indices of the joints of each section that bends evenly, each shape (arcs of the section,).

    The first joint of the arm bends nothing, and neither do those at which bodies are fixed.
    """
    still = {0, *sections.straight}
    bending = [joint for joint in range(int(np.sum(sections.counts)) + len(still)) if joint not in still]
    return np.split(np.array(bending), np.cumsum(sections.counts)[:-1])


def section_of(arm: Arm, joint: int) -> str:
    """Return the name of the section that bends evenly to which a joint and the link behind it belong; else nothing."""
    if arm.sections is None:
        return ""
    ends = [joints[-1] for joints in section_joints(arm.sections)]
    return f"section {min(int(np.searchsorted(ends, joint)), len(ends) - 1) + 1}"


def torque_limits(arm: Arm, limits: FloatArray) -> FloatArray:
    """Return the torque limits of these drives, shape (m,): the least of those of the joints that each moves."""
    if arm.coupled is not None:
        of_bends = limits.reshape(arm.links, 3)[:, :2].ravel()
        return np.array([np.min(of_bends[ratios != 0.0]) for ratios in arm.coupled.ratios.T])
    if arm.sections is None:
        return limits
    bends = limits.reshape(arm.links, 3)[:, 3 - arm.dimension : 2]
    return np.concatenate([np.min(bends[joints], axis=0) for joints in section_joints(arm.sections)])


def describe_drives(arm: Arm, names: Sequence[str]) -> tuple[str, ...]:
    """Return readable names of these drives, from those of the revolutes."""
    if arm.coupled is not None:
        return tuple(f"drive {k + 1}" for k in range(arm.coupled.ratios.shape[1]))
    if arm.sections is None:
        return describe_revolute_joints(names)
    kinds = ("",) if arm.dimension == 2 else (" a", " b")
    return tuple(f"section {k + 1}{bend}" for k in range(len(arm.sections.counts)) for bend in kinds)


def describe_bend_joint(coordinates: Coordinates, number: int) -> str:
    """Return a readable name of the joint to which bend `number` (from 0) belongs, such as "joint 3 a"."""
    each = bends_a_ball(coordinates)
    return f"joint {number + 1}" if each == 1 else f"joint {number // each + 1} {'ab'[number % each]}"


def describe_bend_joints(coordinates: Coordinates) -> tuple[str, ...]:
    """Return a readable joint name per bend, such as "joint 3 a"."""
    return tuple(describe_bend_joint(coordinates, number) for number in range(coordinates.joints))


def describe_revolute_joints(names: Sequence[str]) -> tuple[str, ...]:
    """Return readable names of the revolutes with given names, such as "joint 3 (name)", counted from 1."""
    return tuple(f"joint {number // 3 + 1} ({name})" for number, name in enumerate(names))


def sample_words(time: FloatArray, names: Sequence[str] = ()) -> Callable[..., str]:
    """Return a function that describes a sample and, optionally, a named column, such as "joint 3 at t = 0.5 s"."""
    return lambda k, *column: " at ".join((*(names[j] for j in column), f"t = {time[k]:.4f} s"))


def check_worst(
    name: str,
    unit: str,
    values: FloatArray,
    allowed: FloatArray | float,
    where: Callable[..., str],
    tolerance: float = 0.0,
) -> Check:
    """Check values against allowed magnitudes; report the value that is the greatest fraction of its allowed magnitude.

    Args:
        name: name of the check.
        unit: unit of the values.
        values: values of any shape and sign.
        allowed: allowed magnitudes, positive, of a shape that broadcasts to that of the values.
        where: describes the location of a value, given its indices.
        tolerance: fraction by which a value may exceed its allowed magnitude.
    """
    sizes = np.abs(values)
    bounds = np.broadcast_to(allowed, sizes.shape)
    # Fractions are compared, since drives may have different limits.
    worst = np.unravel_index(np.argmax(sizes / bounds), sizes.shape)
    size, bound = float(sizes[worst]), float(bounds[worst])
    return Check(name, size, bound, unit, where(*map(int, worst)), passed=size <= bound * (1.0 + tolerance))


def check_names(problem: Problem, joints: JointStates) -> Check:
    """Check that the names of a plan's drives are those of the arm's revolute joints, in order."""
    expected = joint_names(problem.arm)
    # Lists of different lengths are compared over their common part; the surplus counts as wrong below.
    differing = [ours for theirs, ours in zip(joints.names, expected, strict=False) if theirs != ours]
    wrong = len(differing) + abs(len(joints.names) - len(expected))
    where = f"expected {differing[0]!r}" if differing else f"{len(joints.names)} names for {len(expected)} revolutes"
    return Check("joint names", float(wrong), 0.0, "names", where, passed=wrong == 0)
