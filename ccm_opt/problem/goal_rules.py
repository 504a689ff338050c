"""Rules that the start and the goals of a problem must satisfy."""

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from ccm_opt.core.arguments import in_words
from ccm_opt.core.arrays import FloatArray
from ccm_opt.problem.arm_rules import carrier_defects, feed_defects
from ccm_opt.problem.poses import Coverage, LookAt, TipGoal, Tolerances
from ccm_opt.problem.value_rules import UNIT_ROUNDING, array_defects, broken, unit_defects
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.tool import across
from ccm_opt.scene.surface_pieces import MOST_PIECES, piece_count, surface_centre, without_flat_parts

if TYPE_CHECKING:
    from ccm_opt.problem.definition import Problem


MOST_FIELD_OF_VIEW = float(np.deg2rad(170.0))
"""Largest field of view of a goal that looks at a place [rad]: the last link never hides what lies before it."""


def pose_defects(problem: "Problem", d: int) -> Iterator[str]:
    """Yield what is wrong with the start and the goals of a problem in d dimensions."""
    links = problem.arm.links
    poses = [("start", problem.start, Tolerances()), ("goal", problem.goal, problem.tolerances)]
    poses += [(f"stop {k}", stop.goal, stop.tolerances) for k, stop in enumerate(problem.stops, start=1)]
    yield from _name_defects(problem)
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
            yield from unit_defects(f"{name}.direction", pose.direction, d)
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
    yield from carrier_defects(problem)


def _name_defects(problem: "Problem") -> Iterator[str]:
    if problem.start.name:
        yield "start.name has no effect, only goals have names; leave it out"
    names: list[object] = [stop.goal.name for stop in problem.goals]
    for number, name in enumerate(names, start=1):
        if not isinstance(name, str):
            yield f"the name of goal {number} must be a str, got {in_words(name)}"


MOST_TURN_WITH_UP = float(np.deg2rad(45.0))
"""Largest tolerance of a goal's direction beside an up direction [rad]: the tool's up axis stays well across it."""


def _up_defects(name: str, goal: TipGoal, up: FloatArray, tolerances: Tolerances, arm: Arm) -> Iterator[str]:
    """Yield a sentence for each defect of the up direction of a goal of an arm."""
    if arm.dimension == 2:
        yield f"{name}.up is for arms in space; in the plane nothing rolls"
        return
    found = tuple(unit_defects(f"{name}.up", up, 3))
    yield from found
    if found:
        return
    if goal.direction is None:
        yield f"{name}.up needs {name}.direction, about which it fixes the roll"
        return
    yield from broken(
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
        found += tuple(unit_defects(f"{name}.normal", look_at.normal, d))
    yield from found
    if found:
        return
    yield from broken(
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


def coverage_defects(problem: "Problem", coverage: Coverage) -> Iterator[str]:
    """Yield a sentence for every invalid value of what has to be seen, and of the goal that stands for it."""
    name, workspace = "coverage", problem.workspace
    if coverage.within is not None:
        found = tuple(array_defects(f"{name}.within", coverage.within, (2, problem.dimension), positive=False))
        yield from found
        if not found and not np.all(coverage.within[0] < coverage.within[1]):
            yield f"{name}.within must have a lower corner below the upper one"
    unknown = without_flat_parts(workspace, coverage.surfaces)
    yield from broken(
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
    yield from broken(
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
    yield from broken(
        (bool(np.all(np.any(np.diff(path, axis=0), axis=1))), f"{name}.path has the same point twice in succession"),
        (np.array_equal(path[-1], goal.position), f"{name}.path must end at {name}.position"),
        (not goal.via and goal.direction is None, f"{name}.path goes together with neither via nor direction"),
    )
