"""Checks of places: the base outside every obstacle, the goal's tip free and within reach."""

from collections.abc import Sequence

import shapely

from ccm_opt.freespace.workspace import BOUNDARY_NAME, Obstacle, Workspace
from ccm_opt.jointed.arm import Arm
from ccm_opt.problem import Tolerances
from ccm_opt.problem_file.issues import Issues
from ccm_opt.problem_file.keypath import KeyPath
from ccm_opt.problem_file.quantities import METRES

ROUNDING = 1e-9
"""Depths and distances below this are rounding [m]."""


def depth_inside(obstacle: Obstacle, point: Sequence[float]) -> float:
    """How far a point is inside an obstacle [m]; negative outside, minus the distance to it."""
    place = shapely.Point(point)
    inside_core = isinstance(obstacle.core, shapely.Polygon) and shapely.contains_properly(obstacle.core, place)
    edge = obstacle.core.boundary if isinstance(obstacle.core, shapely.Polygon) else obstacle.core
    distance = float(shapely.distance(edge, place))
    return obstacle.rounding + (distance if inside_core else -distance)


def depth_outside(workspace: Workspace, point: Sequence[float]) -> float:
    """How far a point is outside the boundary [m]; negative inside, minus the distance to it."""
    return -depth_inside(Obstacle(BOUNDARY_NAME, workspace.boundary), point)


def check_base(workspace: Workspace, base: Sequence[float], units: str, issues: Issues) -> None:
    """The base may touch walls, as the mount does, but not stand inside an obstacle or outside the room."""
    for obstacle in workspace.obstacles:
        if (depth := depth_inside(obstacle, base)) > ROUNDING:
            issues.add(("arm", "base"), f"the base is {_length(depth, units)} inside '{obstacle.name}'; move it out")
    if (depth := depth_outside(workspace, base)) > ROUNDING:
        issues.add(("arm", "base"), f"the base is {_length(depth, units)} outside the {BOUNDARY_NAME}; move it in")


def base_places(arm: Arm) -> shapely.Geometry:
    """All places of the base: a point, or with a feed axis the stretch that it covers."""
    if arm.feed is None:
        return shapely.Point(arm.base)
    ends = [arm.base + at * arm.feed_direction for at in (arm.feed.low, arm.feed.high)]
    return shapely.LineString(ends)


def check_goal(
    workspace: Workspace,
    arm: Arm,
    position: Sequence[float],
    tolerances: Tolerances,
    units: str,
    path: KeyPath,
    issues: Issues,
) -> None:
    """The tip must fit at some point within the position tolerance of the goal, and reach it."""
    gap = arm.radius + workspace.clearance
    walls = [(depth_inside(obstacle, position), f"inside '{obstacle.name}'") for obstacle in workspace.obstacles]
    walls.append((depth_outside(workspace, position), f"outside the {BOUNDARY_NAME}"))
    for depth, place in walls:
        if depth + gap > tolerances.position + ROUNDING and arm.mount_length < arm.length:
            issues.add(path, _no_room(depth, place, gap, units))
    distance = float(shapely.distance(base_places(arm), shapely.Point(position)))
    if distance > arm.length + tolerances.position + ROUNDING:
        issues.add(
            path,
            f"out of reach: {_length(distance, units)} from the base; the arm is {_length(arm.length, units)} long, "
            f"{_length(distance - arm.length, units)} too short",
        )


def _no_room(depth: float, place: str, gap: float, units: str) -> str:
    if depth > 0.0:
        return f"the goal is {_length(depth, units)} {place}; move it to free space"
    wall = place.split(" ", 1)[1]
    return (
        f"the goal is only {_length(-depth, units)} from {wall}; "
        f"the tip needs radius + clearance = {_length(gap, units)} of room"
    )


def _length(metres: float, units: str) -> str:
    return f"{metres / METRES[units]:.4g} {units}"
