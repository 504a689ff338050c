"""Rules that the arm of a problem must satisfy, with its couplings, sections, drives and base axes."""

from collections.abc import Iterator, Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, get_args

import numpy as np

from ccm_opt.core.arguments import is_number
from ccm_opt.problem.options import (
    ControllerName,
    MethodName,
    OptimiserName,
    OrderName,
    PlannerOptions,
    RetimingName,
    SimulationOptions,
    TourEnd,
)
from ccm_opt.problem.value_rules import (
    UNIT_ROUNDING,
    NamedArray,
    array_defects,
    broken,
    name_defects,
    positive,
    unit_defects,
)
from ccm_opt.robot.arc_sections import ArcSections
from ccm_opt.robot.arm import Arm, Axes
from ccm_opt.robot.base_axes import MOST_AXES
from ccm_opt.robot.coordinates import Limits
from ccm_opt.robot.couplings import DRIVES_MISFIT, DriveCoupling
from ccm_opt.robot.link_layout import Proportions

if TYPE_CHECKING:
    from ccm_opt.problem.definition import Problem


def arm_defects(arm: Arm, d: int) -> Iterator[str]:
    """Yield what is wrong with an arm in d dimensions."""
    yield from broken(
        (
            arm.links >= 2 and (arm.links % 2 == 0 or arm.proportions is not None),
            f"arm.links must be at least 2, and even where all links are equal, got {arm.links}",
        ),
        (
            arm.link_length > 0.0 and arm.radius >= 0.0,
            f"arm.link_length must be positive and arm.radius not negative, got {arm.link_length} and {arm.radius}",
        ),
        (arm.mount_length >= 0.0, f"arm.mount_length must not be negative, got {arm.mount_length}"),
        (
            not arm.carrier or arm.mount_length == 0.0,
            f"arm.mount_length must be 0 on base axes, which move the mount, got {arm.mount_length}",
        ),
        (arm.joint_limit > 0.0, f"arm.joint_limit must be positive, got {arm.joint_limit}"),
        (arm.base_limit >= 0.0, f"arm.base_limit must not be negative, got {arm.base_limit}"),
    )
    if arm.proportions is not None:
        yield from _proportion_defects(arm.proportions, arm.links, d - 1)
    yield from array_defects("arm.base", arm.base, (d,), positive=False)
    yield from unit_defects("arm.direction", arm.direction, d)
    if d == 2:
        return
    yield from broken((arm.axes == "zyx", f'arm.axes must be "zyx" in space, got {arm.axes!r}'))
    yield from unit_defects("arm.up", arm.up, d)
    vectors = [np.asarray(vector) for vector in (arm.direction, arm.up)]
    if all(vector.shape == (3,) for vector in vectors) and abs(float(vectors[0] @ vectors[1])) > UNIT_ROUNDING:
        yield "arm.up must be perpendicular to arm.direction"


def _proportion_defects(proportions: Proportions, links: int, bends_a_joint: int) -> Iterator[str]:
    for name in ("lengths", "radii", "limits"):
        values = getattr(proportions, name)
        shape = (bends_a_joint * links if name == "limits" else links,)
        found = tuple(array_defects(f"arm.proportions.{name}", values, shape, positive=name == "lengths"))
        yield from found
        if found:
            continue
        if name == "lengths" and abs(float(np.mean(values)) - 1.0) > UNIT_ROUNDING:
            yield f"arm.proportions.lengths must be 1 in the mean, got {float(np.mean(values)):g}"
        if name != "lengths" and not (np.all(values >= 0.0) and abs(float(np.max(values)) - 1.0) <= UNIT_ROUNDING):
            yield f"arm.proportions.{name} must be from 0 to 1 and reach 1, got {values.min():g} to {values.max():g}"


def coupling_defects(problem: "Problem", drives: DriveCoupling) -> Iterator[str]:
    """Yield a sentence for everything in a problem that drives of several joints do not support."""
    arm, limits = problem.arm, problem.limits
    what = "coupled joints" if arm.sections is None else "sections that bend evenly"
    yield from broken(
        (arm.dimension == 3 or arm.coupled is None, "coupled joints are for arms in space"),
        (arm.sections is None or arm.coupled is None, "an arm has either sections that bend evenly or coupled joints"),
        (
            arm.feed is None or all(each.goal.path is None for each in problem.goals),
            f"goal.path is not supported for {what} on a feed axis; make it the last of arm.base.axes",
        ),
        (not limits.points, f"limits of points of the arm are not supported for {what}"),
        (problem.joint_error == 0.0, f"tolerance.joint_error is not supported for {what}"),
        (problem.planner.method == "nlp", f"planner.method must be 'nlp' for {what}"),
        (problem.planner.retiming == "toppra", f"planner.retiming must be 'toppra' for {what}"),
    )
    matrix = drives.coupling
    if len(matrix) != arm.bends_a_joint * arm.links:
        expected = f"expected {arm.bends_a_joint} for each of {arm.links} joints"
        yield f"{what}: the coupling has {len(matrix)} rows; {expected}"
        return
    if arm.sections is None and (np.any(np.sum(matrix != 0.0, axis=1) > 1) or not np.all(np.any(matrix, axis=0))):
        yield "arm.coupled must move each bend by one drive at most, and something by each drive"
        return
    poses = [("start", problem.start), ("goal", problem.goal)]
    poses += [(f"stop {k}", stop.goal) for k, stop in enumerate(problem.stops, start=1)]
    for name, pose in poses:
        joints = pose.for_joints
        if joints and np.size(joints.bends) == len(matrix):
            misfit = drives.misfit(np.ravel(joints.bends))
            if misfit > DRIVES_MISFIT:
                yield f"{name}.bends differ by up to {np.rad2deg(misfit):.3g}° from those of {what}"
            used = drives.travel_used(np.ravel(joints.bends))
            if used > 1.0 + DRIVES_MISFIT:
                yield f"{name}.bends take {100.0 * used:.4g} % of the travel of a tendon"


def section_defects(problem: "Problem", sections: ArcSections) -> Iterator[str]:
    """Yield a sentence if an arm differs from its sections that bend evenly."""
    arm = problem.arm
    if arm.links != sections.links or np.any(arm.radii < sections.link_radii * (1.0 - UNIT_ROUNDING)):
        yield "arm.sections differ from its number of links, or its radii do not contain their arcs"


def drive_defects(arm: Arm, limits: Limits, planner: PlannerOptions, simulation: SimulationOptions) -> Iterator[str]:
    """Yield a sentence for every invalid mass, limit, planner option or simulation option, planar or in space."""
    for name, value, shape in _positive_arrays(arm, limits):
        yield from array_defects(name, value, shape, positive=True)
    for key, name, names in (
        ("arm.axes", arm.axes, get_args(Axes)),
        ("planner.method", planner.method, get_args(MethodName)),
        ("planner.optimiser", planner.optimiser, get_args(OptimiserName)),
        ("planner.retiming", planner.retiming, get_args(RetimingName)),
        ("planner.order", planner.order, get_args(OrderName)),
        ("planner.end", planner.end, get_args(TourEnd)),
        ("simulation.controller", simulation.controller, get_args(ControllerName)),
    ):
        yield from name_defects(key, name, names)
    yield from broken(
        *(
            (0.0 <= value < np.inf, f"planner.weights.{name} must be finite and not negative, got {value}")
            for name, value in asdict(planner.weights).items()
        )
    )
    yield from _point_defects(arm, limits)
    share, within = planner.effort_share, planner.follow_within
    smooth = limits.jerk is not None or limits.feed_jerk is not None
    yield from broken(
        (0.0 < share <= 1.0, f"planner.effort_share must be above 0 and at most 1, got {share}"),
        (
            planner.retiming != "paul" or not smooth,
            'limits.jerk and limits.feed_jerk need planner.retiming = "toppra", got "paul"',
        ),
        (
            within is None or (is_number(within) and within > 0.0),
            f"planner.follow_within must be positive or None, got {within}",
        ),
    )


def _point_defects(arm: Arm, limits: Limits) -> Iterator[str]:
    """Yield a sentence for every invalid limit on a point of the arm: off the arm, not positive, empty, or repeated."""
    for k, point in enumerate(limits.points):
        name = f"limits.points[{k}]"
        others = [other.at for other in limits.points[:k]]
        on_arm = point.at is None or 0.0 <= point.at <= arm.length * (1.0 + 1e-9)
        yield from broken(
            (on_arm, f"{name}.at must be between 0 and the arm's length of {arm.length:g} m, got {point.at} m"),
            positive(f"{name}.velocity", point.velocity),
            positive(f"{name}.acceleration", point.acceleration),
            (min(point.velocity, point.acceleration) < np.inf, f"{name} limits neither velocity nor acceleration"),
            (point.at not in others, f"{name}: the {point.name} is limited already; give one entry per point"),
        )


def feed_defects(arm: Arm, limits: Limits, placed: Sequence[tuple[str, float]]) -> Iterator[str]:
    """Yield a sentence for every invalid value of the feed axis, of its limits, and of the feeds of poses.

    Args:
        arm: the arm; without a feed axis, every feed but 0 is invalid.
        limits: limits of the drives, including the feed axis.
        placed: name and feed (position of the base on the axis) of each pose [m].
    """
    if arm.carrier:
        return
    if not arm.base_axes:
        yield from (
            f"{name}.feed is {value} m, but the arm has no feed axis; set arm.feed, or leave it out"
            for name, value in placed
            if value
        )
    for axis in arm.base_axes:
        yield from broken(
            (axis.low < axis.high, f"arm.feed must have low < high, got {axis.low} and {axis.high}"),
            *(
                (
                    bool(value and value > 0.0),
                    f"limits.{key} must be positive when the arm has a feed axis, got {value}",
                )
                for key in ("feed_velocity", "feed_acceleration")
                for value in (getattr(limits, key),)
            ),
            positive("limits.feed_force", limits.feed_force),
            positive("limits.feed_jerk", limits.feed_jerk),
            *(
                (
                    axis.low <= value <= axis.high,
                    f"{name}.feed must be within the range of the axis, {axis.low} to {axis.high} m, got {value} m",
                )
                for name, value in placed
            ),
        )


def carrier_defects(problem: "Problem") -> Iterator[str]:
    """Yield a sentence for every invalid axis that carries the base, of its limits, and of its positions in poses."""
    arm, limits = problem.arm, problem.limits
    if not arm.carrier:
        yield from broken(
            (limits.axes is None, "limits.axes is given, but no axes carry the arm: arm.carrier is empty")
        )
        return
    count = len(arm.carrier)
    yield from broken(
        (count <= MOST_AXES, f"arm.carrier must have at most {MOST_AXES} axes, got {count}"),
        (arm.feed is None, "arm.feed and arm.carrier must not both be given; make the feed axis one of the carrier"),
        (limits.axes is not None, "limits.axes must give the limits of the axes that carry the arm, got None"),
        (problem.joint_error == 0.0, "joint_error is not supported for an arm on axes that carry it"),
        (not limits.points, "limits of points are not supported for an arm on axes that carry it"),
    )
    for k, axis in enumerate(arm.carrier):
        yield from unit_defects(f"arm.carrier[{k}].direction", axis.direction, 3)
        yield from array_defects(f"arm.carrier[{k}].point", axis.point, (3,), positive=False)
        yield from broken(
            (axis.low < axis.high, f"arm.carrier[{k}] must have low < high, got {axis.low} and {axis.high}"),
            (axis.inertia >= 0.0, f"arm.carrier[{k}].inertia must not be negative, got {axis.inertia}"),
        )
    if limits.axes is not None:
        for name in ("velocity", "acceleration"):
            yield from array_defects(f"limits.axes.{name}", getattr(limits.axes, name), (count,), positive=True)
    for name, pose in [("start", problem.start), ("goal", problem.goal)]:
        if pose.for_joints is None:
            continue
        values = np.broadcast_to(pose.for_joints.feed, count)
        yield from (
            f"{name}: axis {k} is at {value:g}, outside its range from {axis.low:g} to {axis.high:g} {axis.unit}"
            for k, (axis, value) in enumerate(zip(arm.carrier, values, strict=True), start=1)
            if not axis.low <= value <= axis.high
        )


def _positive_arrays(arm: Arm, limits: Limits) -> Iterator[NamedArray]:
    for name in ("masses", "inertia_axial", "inertia_transverse"):
        yield f"arm.{name}", getattr(arm, name), (arm.links,)
    for name in ("velocity", "acceleration", "torque", "jerk"):
        if getattr(limits, name) is not None:
            yield f"limits.{name}", getattr(limits, name), (3 * arm.links,)
