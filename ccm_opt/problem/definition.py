"""The planning problem as immutable data, and the checks that every problem must pass."""

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any, TypeAlias, get_args

import numpy as np

from ccm_opt.core.arguments import expect, is_number
from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import ProblemError
from ccm_opt.core.length_words import LengthUnit, long_length, words_in
from ccm_opt.problem.field_types import ImportedArm, ImportedDrawing, wrong_types
from ccm_opt.problem.options import (
    CONTACT_SHARE_OF_LENGTH,
    MOST_CONTACT_SHARE_OF_LENGTH,
    ControllerName,
    MethodName,
    OptimiserName,
    OrderName,
    PlannerOptions,
    RetimingName,
    SimulationOptions,
    TourEnd,
    VerificationOptions,
)
from ccm_opt.problem.poses import Coverage, Goal, JointPose, LookAt, Stop, TipGoal, Tolerances
from ccm_opt.problem.tool_rules import Key, tool_defects
from ccm_opt.robot.arc_sections import ArcSections
from ccm_opt.robot.arm import Arm, Axes, MappingName
from ccm_opt.robot.base_axes import MOST_AXES
from ccm_opt.robot.coordinates import Limits
from ccm_opt.robot.couplings import DriveCoupling
from ccm_opt.robot.link_layout import Proportions
from ccm_opt.robot.tool import across
from ccm_opt.scene.bodies import Body
from ccm_opt.scene.surface_pieces import MOST_PIECES, piece_count, surface_centre, without_flat_parts
from ccm_opt.scene.workspace import PlaneShape, Workspace

UNIT_ROUNDING = 1e-9
"""Allowed rounding error of the length of a unit vector, and of the cosine of a right angle."""
MOST_FIELD_OF_VIEW = float(np.deg2rad(170.0))
"""Largest field of view of a goal that looks at a place [rad]: the last link never hides what lies before it."""
_Array: TypeAlias = tuple[str, FloatArray, tuple[int, ...]]  # name, value, shape


def defects(problem: "Problem") -> Iterator[str]:
    """Yield a sentence for every invalid value of a problem, whether read from a file or made in Python.

    All attributes must already have the right types, see ``wrong_types``. Problem files undergo further checks when
    they are read, see ``ccm_opt.io``.
    """
    d = problem.workspace.dimension
    if d == 3 and problem.workspace.bounds is None and np.shape(problem.arm.base) == (2,):
        yield "workspace.boundary must be a non-empty polygon for an arm in the plane"
        return
    yield from _arm_defects(problem.arm, d)
    yield from _workspace_defects(problem.workspace)
    yield from _name_defects("planner.mapping", problem.planner.mapping, get_args(MappingName))
    yield from drive_defects(problem.arm, problem.limits, problem.planner, problem.simulation)
    yield from array_defects("simulation.gravity", problem.simulation.gravity, (3,), positive=False)
    error, contact = problem.joint_error, problem.contact_tolerance
    yield from _broken(
        (0.0 <= error < np.pi, f"tolerance.joint_error must be at least 0 and below π rad, got {error}"),
        (
            0.0 < contact <= MOST_CONTACT_SHARE_OF_LENGTH * problem.arm.length,
            f"verification.contact_tolerance must be positive and at most {_MOST_CONTACT_WORDS}, got {contact}",
        ),
    )
    yield from _pose_defects(problem, d)
    given: dict[Key, Any] = {
        ("arm", "payload"): problem.arm.payload,
        ("limits", "points"): problem.limits.points,
        ("tolerance", "joint_error_deg"): error,
        ("planner", "follow_within"): problem.planner.follow_within,
        ("planner", "method"): problem.planner.method,
    }
    yield from (f"{'.'.join(map(str, key))}: {defect}" for key, defect in tool_defects(problem.arm, given))
    if problem.arm.drives is not None:
        yield from coupling_defects(problem, problem.arm.drives)
    if problem.arm.sections is not None:
        yield from section_defects(problem, problem.arm.sections)
    yield from _tour_defects(problem)
    if problem.coverage is not None:
        yield from _coverage_defects(problem, problem.coverage)


def _tour_defects(problem: "Problem") -> Iterator[str]:
    """Yield a sentence for everything that goals in free order, or in the given one, do not support."""
    planner = problem.planner
    if not problem.pause >= 0.0:
        yield f"goal.pause must not be negative, got {problem.pause}"
    if planner.order != "free":
        if planner.end != "free":
            yield f'planner.end = "{planner.end}" needs planner.order = "free"; a motion in given order ends as given'
        return
    goals = [stop.goal for stop in problem.goals]
    yield from _broken(
        (all(goal.path is None for goal in goals), 'goal.path is not supported with planner.order = "free"'),
        (
            not any(goal.via for goal in goals),
            'goal.via is not supported with planner.order = "free"; give each place as a goal, in a table [[goal]]',
        ),
        (planner.follow_within is None, 'planner.follow_within is not supported with planner.order = "free"'),
        (planner.tries == 1, 'planner.tries must be 1 with planner.order = "free"'),
        (planner.method == "nlp", f'planner.order = "free" needs planner.method = "nlp", got "{planner.method}"'),
        (
            planner.retiming == "toppra",
            f'planner.order = "free" needs planner.retiming = "toppra", got "{planner.retiming}"',
        ),
        (problem.joint_error == 0.0, 'tolerance.joint_error is not supported with planner.order = "free"'),
    )


_MOST_CONTACT_WORDS = "a thousandth of the arm's length"


def _broken(*rules: tuple[bool | np.bool_, str]) -> Iterator[str]:
    """Yield the message of every violated rule, each rule given as a pair (holds, message)."""
    yield from (line for holds, line in rules if not holds)


def _arm_defects(arm: Arm, d: int) -> Iterator[str]:
    yield from _broken(
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
    yield from _unit_defects("arm.direction", arm.direction, d)
    if d == 2:
        return
    yield from _broken((arm.axes == "zyx", f'arm.axes must be "zyx" in space, got {arm.axes!r}'))
    yield from _unit_defects("arm.up", arm.up, d)
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


_MISFIT = 1e-9
"""Largest difference of a joint's bend from its share of its drive that is attributed to rounding [rad]."""


def coupling_defects(problem: "Problem", drives: DriveCoupling) -> Iterator[str]:
    """Yield a sentence for everything in a problem that drives of several joints do not support."""
    arm, limits = problem.arm, problem.limits
    what = "coupled joints" if arm.sections is None else "sections that bend evenly"
    yield from _broken(
        (arm.dimension == 3, f"{what} are for arms in space"),
        (arm.sections is None or arm.coupled is None, "an arm has either sections that bend evenly or coupled joints"),
        (
            arm.feed is None,
            f"arm.feed is not supported for {what}; without guide tube, make it the last of arm.base.axes",
        ),
        (not limits.points, f"limits of points of the arm are not supported for {what}"),
        (problem.joint_error == 0.0, f"tolerance.joint_error is not supported for {what}"),
        (problem.planner.method == "nlp", f"planner.method must be 'nlp' for {what}"),
        (problem.planner.retiming == "toppra", f"planner.retiming must be 'toppra' for {what}"),
    )
    matrix = drives.coupling
    if len(matrix) != 2 * arm.links:
        yield f"{what}: the coupling has {len(matrix)} rows; expected two for each of {arm.links} joints"
        return
    if arm.sections is None and (np.any(np.sum(matrix != 0.0, axis=1) > 1) or not np.all(np.any(matrix, axis=0))):
        yield "arm.coupled must move each bend by one drive at most, and something by each drive"
        return
    poses = [("start", problem.start), ("goal", problem.goal)]
    poses += [(f"stop {k}", stop.goal) for k, stop in enumerate(problem.stops, start=1)]
    for name, pose in poses:
        joints = pose.for_joints
        if joints and np.shape(joints.bends) == (arm.links, 2):
            misfit = drives.misfit(np.ravel(joints.bends))
            if misfit > _MISFIT:
                yield f"{name}.bends differ by up to {np.rad2deg(misfit):.3g}° from those of {what}"
            used = drives.travel_used(np.ravel(joints.bends))
            if used > 1.0 + _MISFIT:
                yield f"{name}.bends take {100.0 * used:.4g} % of the travel of a tendon"


def section_defects(problem: "Problem", sections: ArcSections) -> Iterator[str]:
    """Yield a sentence if an arm differs from its sections that bend evenly."""
    arm = problem.arm
    if arm.links != sections.links or np.any(arm.radii < sections.link_radii * (1.0 - UNIT_ROUNDING)):
        yield "arm.sections differ from its number of links, or its radii do not contain their arcs"


def _unit_defects(name: str, vector: FloatArray, d: int) -> Iterator[str]:
    found = tuple(array_defects(name, vector, (d,), positive=False))
    yield from found
    if not found and abs(float(np.linalg.norm(vector)) - 1.0) > UNIT_ROUNDING:
        yield f"{name} must be a unit vector, got length {float(np.linalg.norm(vector)):g}"


def _workspace_defects(workspace: Workspace) -> Iterator[str]:
    if not workspace.clearance >= 0.0:
        yield f"workspace.clearance must not be negative, got {workspace.clearance}"
    if workspace.bounds is not None:
        found = tuple(array_defects("workspace.bounds", workspace.bounds, (2, 3), positive=False))
        yield from found
        if not found and not np.all(workspace.bounds[0] < workspace.bounds[1]):
            yield "workspace.bounds must have a lower corner below the upper one"
    in_space = workspace.dimension == 3
    for obstacle in workspace.obstacles:
        if isinstance(obstacle.shape, PlaneShape) == in_space:
            expected = "a solid in space" if in_space else "a PlaneShape"
            yield f"obstacle '{obstacle.name}': expected {expected}, got a {type(obstacle.shape).__name__}"
        elif in_space:
            yield from (f"obstacle '{obstacle.name}': {defect}" for defect in _body_defects(obstacle.body))


def _body_defects(body: Body) -> Iterator[str]:
    if body.kind == "mesh":
        if not (body.faces.ndim == 2 and body.faces.shape[1] == 3 and len(body.faces)):
            yield f"faces must be rows of three vertices, got shape {body.faces.shape}"
        elif body.faces.min() < 0 or body.faces.max() >= len(body.vertices):
            yield "faces refer to a vertex that does not exist"
        yield from array_defects("vertices", body.vertices, (len(body.vertices), 3), positive=False)
        return
    for name in body.places:
        yield from array_defects(name, getattr(body, name), (3,), positive=False)
    if body.kind == "box":
        if not np.all(np.asarray(body.low) < np.asarray(body.high)):
            yield "low must be below high"
        return
    if not (is_number(body.radius) and body.radius > 0.0):
        yield f"radius must be a positive number, got {body.radius}"
    if body.kind != "sphere" and np.array_equal(body.start, body.end):
        yield "start and end must differ"


def _pose_defects(problem: "Problem", d: int) -> Iterator[str]:
    links = problem.arm.links
    poses = [("start", problem.start, Tolerances()), ("goal", problem.goal, problem.tolerances)]
    poses += [(f"stop {k}", stop.goal, stop.tolerances) for k, stop in enumerate(problem.stops, start=1)]
    placed = []
    for name, pose, tolerances in poses:
        joints = pose.for_joints
        if joints:
            if not problem.arm.carrier:
                placed.append((name, float(joints.feed)))
            yield from array_defects(f"{name}.bends", joints.bends, (links,) if d == 2 else (links, 2), positive=False)
            continue
        yield from array_defects(f"{name}.position", pose.tip(problem.arm), (d,), positive=False)
        if pose.look_at is not None:
            yield from _look_at_defects(name, pose, pose.look_at, tolerances, d)
            continue
        if pose.direction is not None:
            yield from _unit_defects(f"{name}.direction", pose.direction, d)
        if pose.up is not None:
            yield from _up_defects(name, pose, pose.up, tolerances, problem.arm)
        if d == 2 and pose.via:
            yield f"{name}.via is for arms in space; in the plane, make its points stops"
            continue
        for number, via in enumerate(pose.via, start=1):
            yield from array_defects(f"{name}.via {number}", via, (d,), positive=False)
        if pose.path is not None:
            yield from _path_defects(name, pose, pose.path, problem.arm)
    yield from feed_defects(problem.arm, problem.limits, placed)
    yield from _carrier_defects(problem)


MOST_TURN_WITH_UP = float(np.deg2rad(45.0))
"""Largest tolerance of a goal's direction beside an up direction [rad]: the tool's up axis stays well across it."""


def _up_defects(name: str, goal: TipGoal, up: FloatArray, tolerances: Tolerances, arm: Arm) -> Iterator[str]:
    """Yield a sentence for each defect of the up direction of a goal of an arm."""
    if arm.dimension == 2:
        yield f"{name}.up is for arms in space; in the plane nothing rolls"
        return
    found = tuple(_unit_defects(f"{name}.up", up, 3))
    yield from found
    if found:
        return
    if goal.direction is None:
        yield f"{name}.up needs {name}.direction, about which it fixes the roll"
        return
    yield from _broken(
        (
            not np.any(np.isnan(across(up, goal.direction))),
            f"{name}.up is parallel to {name}.direction; expected a vector with a component across it",
        ),
        (
            tolerances.heading <= MOST_TURN_WITH_UP + UNIT_ROUNDING,
            f"{name}.direction_tolerance_deg must be at most 45 with {name}.up",
        ),
        (tolerances.roll > 0.0, f"{name}.roll_tolerance_deg must be positive"),
        (
            arm.tool is None or not np.any(np.isnan(arm.tool.up_axis)),
            f"arm.tool.up must be given with {name}.up, and not be parallel to arm.tool.direction",
        ),
    )


def _look_at_defects(name: str, goal: TipGoal, look_at: LookAt, tolerances: Tolerances, d: int) -> Iterator[str]:
    found = tuple(array_defects(f"{name}.look_at", look_at.place, (d,), positive=False))
    if look_at.normal is not None:
        found += tuple(_unit_defects(f"{name}.normal", look_at.normal, d))
    yield from found
    if found:
        return
    yield from _broken(
        *_sight_rules(name, look_at),
        (
            not goal.via and goal.direction is None and goal.path is None and goal.up is None,
            f"{name}.look_at goes together with neither via nor direction nor path nor up",
        ),
        (np.array_equal(goal.position, look_at.place), f"{name}.position must be the place that is looked at"),
        (tolerances == look_at.tolerances, f"{name}'s tolerances must be those of what it looks at"),
    )


def _sight_rules(name: str, seen: LookAt | Coverage) -> Iterator[tuple[bool, str]]:
    """Yield pairs (holds, message) for the distances, the field of view, and the angle at which something is seen."""
    least, most = seen.distance
    yield (
        0.0 < least < most < np.inf,
        f"{name}.distance must be two increasing positive numbers, got {least}, {most}",
    )
    yield (
        0.0 < seen.field_of_view <= MOST_FIELD_OF_VIEW,
        f"{name}.field_of_view must be positive and at most 2.97 rad, got {seen.field_of_view}",
    )
    yield (
        0.0 < seen.angle <= 0.5 * np.pi,
        f"{name}.angle must be positive and at most a right angle, got {seen.angle}",
    )


def _coverage_defects(problem: "Problem", coverage: Coverage) -> Iterator[str]:
    """Yield a sentence for every invalid value of what has to be seen, and of the goal that stands for it."""
    name, workspace = "coverage", problem.workspace
    if coverage.within is not None:
        found = tuple(array_defects(f"{name}.within", coverage.within, (2, problem.dimension), positive=False))
        yield from found
        if not found and not np.all(coverage.within[0] < coverage.within[1]):
            yield f"{name}.within must have a lower corner below the upper one"
    unknown = without_flat_parts(workspace, coverage.surfaces)
    yield from _broken(
        *_sight_rules(name, coverage),
        (0.0 < coverage.share <= 1.0, f"{name}.share must be above 0 and at most 1, got {coverage.share}"),
        (coverage.spacing > 0.0, f"{name}.spacing must be positive, got {coverage.spacing}"),
        (len(coverage.surfaces) > 0, f"{name}.surfaces must name an obstacle, or the room"),
        (
            not unknown,
            (
                f"{name}.surfaces: no obstacle with flat surfaces is named {', '.join(map(repr, unknown))}; circles, "
                "thick walls, spheres, capsules and scans have none"
            ),
        ),
    )
    if unknown or not coverage.surfaces or not coverage.spacing > 0.0:
        return
    count = piece_count(workspace, coverage.surfaces, coverage.spacing)
    yield from _broken(
        (
            count <= MOST_PIECES,
            f"{name}.spacing of {coverage.spacing:g} m makes {count} pieces; expected at most {MOST_PIECES}",
        ),
        (
            problem.planner.order != "free" or _stands_in(problem, coverage),
            f"{name} with goals in free order needs TipGoal.seeing(coverage, workspace) as its only goal",
        ),
        (
            problem.planner.order == "free" or not _stands_in(problem, coverage),
            'goal.see needs planner.order = "free", since the order of the views that are found is free',
        ),
        (problem.planner.end != "last", 'planner.end = "last" is not supported with goal.see, which has no last goal'),
    )


def _stands_in(problem: "Problem", coverage: Coverage) -> bool:
    """Return whether the only goal of a problem is the one that stands for what has to be seen."""
    goal = problem.goal.for_tip
    if goal is None or problem.stops or goal.look_at or goal.path is not None or goal.via or goal.direction is not None:
        return False
    return np.array_equal(goal.position, surface_centre(problem.workspace, coverage.surfaces))


def _path_defects(name: str, goal: TipGoal, path: FloatArray, arm: Arm) -> Iterator[str]:
    if arm.dimension == 2 or not arm.base_axes:
        yield f"{name}.path is for arms in space whose base moves; leave it out"
        return
    found = tuple(array_defects(f"{name}.path", path, (max(len(path), 2), 3), positive=False))
    yield from found
    if found:
        return
    yield from _broken(
        (bool(np.all(np.any(np.diff(path, axis=0), axis=1))), f"{name}.path has the same point twice in succession"),
        (np.array_equal(path[-1], goal.position), f"{name}.path must end at {name}.position"),
        (not goal.via and goal.direction is None, f"{name}.path goes together with neither via nor direction"),
    )


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
        yield from _name_defects(key, name, names)
    yield from _broken(
        *(
            (0.0 <= value < np.inf, f"planner.weights.{name} must be finite and not negative, got {value}")
            for name, value in asdict(planner.weights).items()
        )
    )
    yield from _point_defects(arm, limits)
    share, within = planner.effort_share, planner.follow_within
    smooth = limits.jerk is not None or limits.feed_jerk is not None
    yield from _broken(
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
        yield from _broken(
            (on_arm, f"{name}.at must be between 0 and the arm's length of {arm.length:g} m, got {point.at} m"),
            _positive(f"{name}.velocity", point.velocity),
            _positive(f"{name}.acceleration", point.acceleration),
            (min(point.velocity, point.acceleration) < np.inf, f"{name} limits neither velocity nor acceleration"),
            (point.at not in others, f"{name}: the {point.name} is limited already; give one entry per point"),
        )


def _positive(name: str, value: float | None) -> tuple[bool, str]:
    """Return a pair (holds, message): whether a limit is positive or None (no limit), and the message if it is not."""
    return value is None or value > 0.0, f"{name} must be positive, got {value}; leave it out for no limit"


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
        yield from _broken(
            (axis.low < axis.high, f"arm.feed must have low < high, got {axis.low} and {axis.high}"),
            *(
                (
                    bool(value and value > 0.0),
                    f"limits.{key} must be positive when the arm has a feed axis, got {value}",
                )
                for key in ("feed_velocity", "feed_acceleration")
                for value in (getattr(limits, key),)
            ),
            _positive("limits.feed_force", limits.feed_force),
            _positive("limits.feed_jerk", limits.feed_jerk),
            *(
                (
                    axis.low <= value <= axis.high,
                    f"{name}.feed must be within the range of the axis, {axis.low} to {axis.high} m, got {value} m",
                )
                for name, value in placed
            ),
        )


def _carrier_defects(problem: "Problem") -> Iterator[str]:
    """Yield a sentence for every invalid axis that carries the base, of its limits, and of its positions in poses."""
    arm, limits = problem.arm, problem.limits
    if not arm.carrier:
        yield from _broken(
            (limits.axes is None, "limits.axes is given, but no axes carry the arm: arm.carrier is empty")
        )
        return
    count = len(arm.carrier)
    yield from _broken(
        (count <= MOST_AXES, f"arm.carrier must have at most {MOST_AXES} axes, got {count}"),
        (arm.feed is None, "arm.feed and arm.carrier must not both be given; make the feed axis one of the carrier"),
        (limits.axes is not None, "limits.axes must give the limits of the axes that carry the arm, got None"),
        (problem.joint_error == 0.0, "joint_error is not supported for an arm on axes that carry it"),
        (not limits.points, "limits of points are not supported for an arm on axes that carry it"),
    )
    for k, axis in enumerate(arm.carrier):
        yield from _unit_defects(f"arm.carrier[{k}].direction", axis.direction, 3)
        yield from array_defects(f"arm.carrier[{k}].point", axis.point, (3,), positive=False)
        yield from _broken(
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


def _positive_arrays(arm: Arm, limits: Limits) -> Iterator[_Array]:
    for name in ("masses", "inertia_axial", "inertia_transverse"):
        yield f"arm.{name}", getattr(arm, name), (arm.links,)
    for name in ("velocity", "acceleration", "torque", "jerk"):
        if getattr(limits, name) is not None:
            yield f"limits.{name}", getattr(limits, name), (3 * arm.links,)


def array_defects(name: str, value: FloatArray, shape: tuple[int, ...], *, positive: bool) -> Iterator[str]:
    """Yield a sentence for the first defect of an array: wrong type or shape, or values not finite or not positive.

    Args:
        name: name of the array, for the message.
        value: the array.
        shape: required shape.
        positive: whether all values must be positive.
    """
    if not hasattr(value, "shape"):
        yield f"{name} must be an array of shape {shape}, got a {type(value).__name__}"
    elif value.shape != shape:
        yield f"{name} must have shape {shape}, got {value.shape}"
    elif not np.all(np.isfinite(value)):
        yield f"{name} must be finite, got {value[~np.isfinite(value)][0]}"
    elif positive and not np.all(value > 0.0):
        yield f"{name} must be positive, got {value[value <= 0.0][0]}"


def _name_defects(key: str, value: str, names: tuple[str, ...]) -> Iterator[str]:
    if value not in names:
        yield f"{key} must be one of {', '.join(names)}, got {value!r}"


WANTED_SHARE_OF_LENGTH = 0.015
"""Default preferred clearance, as a fraction of the arm's length."""
WANTED_SHARE_OF_RADIUS = 0.5
"""Default preferred clearance, as a fraction of the arm's radius; applies if smaller than the default by length."""


@dataclass(frozen=True, repr=False)
class Problem:
    """A motion-planning problem for a planar arm or an arm in space, in SI units and radians.

    Attributes:
        name: name of the problem and of its output folder.
        description: one line for human readers.
        workspace: boundary, obstacles and required clearance.
        arm: the jointed arm.
        limits: limits of joint velocity, acceleration, torque and jerk, of the feed axis, and of points of the arm.
        start: pose in which the motion begins.
        goal: goal at which the motion ends.
        tolerances: maximum deviation from the goal at the end of the motion.
        stops: intermediate goals, in order.
        pause: time for which the arm rests at ``goal`` if others follow it, which takes a free order [s].
        planner: planner options.
        simulation: simulation options.
        joint_error: deviation of any joint, at any time, under which the motion must remain collision-free [rad]; 0 for
            no such requirement.
        verification: verification options.
        source: text of the problem file, kept for the record; empty for problems built in Python or with a drawing.
        length_unit: unit of lengths in messages, taken from the problem file: ``m``, ``mm`` or ``in``; values are
            always in metres.
        drawing: report on the drawing from which obstacles were imported; None without a drawing.
        imported_arm: report on the URDF file from which the arm was read; None without one.
        coverage: surfaces that have to be seen from the goals; None for none. With goals in free order, goals are found
            for it, and ``goal`` is ``TipGoal.seeing(coverage, workspace)``.

    Raises:
        ProblemError: an attribute has a wrong type or shape, or an invalid value; the message lists all of them.
    """

    name: str
    workspace: Workspace
    arm: Arm
    limits: Limits
    start: JointPose
    goal: Goal
    description: str = ""
    tolerances: Tolerances = field(default_factory=Tolerances)
    stops: tuple[Stop, ...] = ()
    planner: PlannerOptions = field(default_factory=PlannerOptions)
    simulation: SimulationOptions = field(default_factory=SimulationOptions)
    joint_error: float = 0.0
    verification: VerificationOptions = field(default_factory=VerificationOptions)
    source: str = ""
    length_unit: LengthUnit = "m"
    drawing: ImportedDrawing | None = None
    imported_arm: ImportedArm | None = None
    pause: float = 0.0
    coverage: Coverage | None = None

    @property
    def dimension(self) -> int:
        """Dimension of the arm's motion, 2 for a planar arm and 3 for an arm in space."""
        return self.arm.dimension

    @property
    def via_reach(self) -> float:
        """Maximum distance at which the tip must pass each via point of the goal [m]."""
        return max(self.tolerances.position, self.arm.own_link_length)

    @property
    def contact_tolerance(self) -> float:
        """Maximum shortfall of the required clearance that the verifier accepts, meant for rounding [m]."""
        requested = self.verification.contact_tolerance
        return CONTACT_SHARE_OF_LENGTH * self.arm.length if requested is None else requested

    @property
    def wanted_gap(self) -> float:
        """Preferred clearance beyond the required clearance, kept by plans if the scene allows it [m].

        0 for the hill-climbing planner of the paper, which ignores this preference.
        """
        if self.planner.method != "nlp":
            return 0.0
        return self.default_gap if self.planner.wanted_gap is None else self.planner.wanted_gap

    @property
    def default_gap(self) -> float:
        """Default preferred clearance, the lesser of 1.5 % of the arm's length and half its radius [m].

        This is about the distance that one would keep around a hose of the arm's size. For an arm of zero radius the
        value is 1.5 % of its length.
        """
        share = WANTED_SHARE_OF_LENGTH * self.arm.length
        return share if self.arm.radius == 0.0 else min(share, WANTED_SHARE_OF_RADIUS * self.arm.radius)

    def __repr__(self) -> str:
        arm = self.arm
        goals = f", {len(self.stops) + 1} goals" if self.stops else ""
        obstacle_words = f"{len(self.workspace.obstacles)} obstacles"
        with words_in(self.length_unit):
            length = long_length(arm.length)
        return f"<{type(self).__name__} '{self.name}': {arm.links} links, {length} long, {obstacle_words}{goals}>"

    @property
    def goals(self) -> Sequence[Stop]:
        """All goals in order, the intermediate ones first; the final goal has no pause."""
        return (*self.stops, Stop(self.goal, self.tolerances))

    @property
    def numbered_goals(self) -> Sequence[Stop]:
        """All goals in the order of the problem, each with its pause."""
        return (*self.stops, Stop(self.goal, self.tolerances, self.pause))

    @staticmethod
    def expected(value: object) -> None:
        """Raise an error if a value is not a ``Problem``.

        Raises:
            ProblemError: the value is not a ``Problem``; the message states its type and how to load a problem.
        """
        expect(value, Problem, "a ccm_opt.Problem", "ccm_opt.load_problem reads one from a file")

    def __post_init__(self) -> None:
        # Types first: a field of the wrong type would make the checks of values fail with an obscure error.
        found = tuple(wrong_types(self)) or tuple(defects(self))
        if found:
            raise ProblemError(f"problem '{self.name}' cannot be used:\n" + "\n".join(f"  {line}" for line in found))
