"""Random planar scenes with wide goals whose centre is unreachable: in a wall, behind a wall or in a closed box."""

import numpy as np
import shapely
from shapely import affinity

from ccm_opt.cli.compare.suites import ROOM
from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.polyline import unit_vector
from ccm_opt.problem import Problem, TipGoal, Tolerances
from ccm_opt.robot.arm import Arm
from ccm_opt.scene.workspace import Obstacle, PlaneShape, Workspace

from .scenes import Scene, make_arm

Drawn = tuple[Problem, TipGoal, Tolerances]
"""A problem with a narrow goal, and a wide goal with its tolerances that contains the narrow one."""


def _straight_start(rng: np.random.Generator, arm: Arm, workspace: Workspace) -> FloatArray:
    """Return the link headings of a straight arm in a random collision-free direction, shape (links,) [rad]."""
    walls = shapely.union_all([obstacle.core for obstacle in workspace.obstacles])
    while True:
        heading = rng.uniform(-np.pi, np.pi)
        reach = shapely.LineString([arm.base, arm.base + arm.length * unit_vector(heading)])
        if reach.distance(walls) > arm.radius + 0.01:
            return np.full(arm.links, heading)


def _problem(rng: np.random.Generator, arm: Arm, obstacles: tuple[Obstacle, ...], goal: TipGoal) -> Problem:
    workspace = Workspace(ROOM, obstacles)
    start = _straight_start(rng, arm, workspace)
    return Scene(arm, workspace, start, start).problem(goal)


def _placed(shape: shapely.Geometry, place: FloatArray, turn: float) -> shapely.Geometry:
    """Return a shape rotated about the origin by an angle [rad], then translated by a vector, shape (2,) [m]."""
    turned = affinity.rotate(shape, turn, origin=(0.0, 0.0), use_radians=True)
    return affinity.translate(turned, *place)


def slot(rng: np.random.Generator) -> Drawn:
    """Return a goal between two parallel walls with a wide range of headings, of which few are possible."""
    arm = make_arm(radius=0.02)
    middle = 0.7 * unit_vector(rng.uniform(-np.pi, np.pi))
    outwards = float(np.arctan2(middle[1], middle[0]))
    turn = outwards + rng.uniform(-0.6, 0.6)
    half = arm.radius + rng.uniform(0.01, 0.03)
    sides = [_placed(shapely.box(-0.18, y, 0.18, y + 0.03), middle, turn) for y in (half, -half - 0.03)]
    obstacles = tuple(Obstacle(f"side {k}", PlaneShape(side)) for k, side in enumerate(sides))
    width = float(np.deg2rad(rng.choice((30.0, 60.0, 180.0))))
    heading = turn + 0.9 * width * rng.uniform(-1.0, 1.0)
    problem = _problem(rng, arm, obstacles, TipGoal(middle, heading=turn))
    return problem, TipGoal(middle, heading=heading), Tolerances(heading=width)


def pocket(rng: np.random.Generator) -> Drawn:
    """Return a goal near the bottom of a blind hole; the centre of the goal disc lies in the bottom."""
    arm = make_arm(radius=0.02)
    mouth = 0.5 * unit_vector(rng.uniform(-np.pi, np.pi))
    turn = float(np.arctan2(mouth[1], mouth[0])) + rng.uniform(-0.3, 0.3)
    half = arm.radius + rng.uniform(0.008, 0.02)
    depth = rng.uniform(0.08, 0.16)
    parts = [
        shapely.box(0.0, half, 0.25, 0.3),
        shapely.box(0.0, -0.3, 0.25, -half),
        shapely.box(depth, -half, 0.25, half),
    ]
    obstacles = tuple(Obstacle(f"part {k}", PlaneShape(_placed(part, mouth, turn))) for k, part in enumerate(parts))
    direction = unit_vector(turn)
    narrow = TipGoal(mouth + (depth - arm.radius - 0.008) * direction, heading=turn)
    middle = mouth + (depth + rng.uniform(0.0, 0.06)) * direction
    width = float(np.hypot(*(middle - narrow.position))) * rng.uniform(1.05, 1.3)
    problem = _problem(rng, arm, obstacles, narrow)
    return problem, TipGoal(middle, heading=turn), Tolerances(position=width)


def wall_behind(rng: np.random.Generator) -> Drawn:
    """Return a goal in front of a wall; the centre of the goal disc lies in or behind the wall."""
    arm = make_arm(radius=0.02)
    heading = rng.uniform(-np.pi, np.pi)
    direction = unit_vector(heading)
    distance = rng.uniform(0.4, 0.8)
    length = rng.uniform(0.3, 0.7)
    wall = _placed(shapely.box(0.0, -length, 0.03, length), distance * direction, heading + rng.uniform(-0.4, 0.4))
    narrow = TipGoal((distance - 0.13) * direction)
    middle = (distance + rng.uniform(0.0, 0.1)) * direction
    width = float(np.hypot(*(middle - narrow.position))) * rng.uniform(1.0, 1.5) + 0.005
    problem = _problem(rng, arm, (Obstacle("wall", PlaneShape(wall)),), narrow)
    return problem, TipGoal(middle), Tolerances(position=width)


def box_beside(rng: np.random.Generator) -> Drawn:
    """Return a goal beside a closed box; the centre of the goal disc lies in the free interior of the box."""
    arm = make_arm(radius=0.02)
    heading = rng.uniform(-np.pi, np.pi)
    middle = rng.uniform(0.4, 0.75) * unit_vector(heading)
    half = rng.uniform(0.05, 0.09)
    shell = shapely.box(-half, -half, half, half).difference(
        shapely.box(-half + 0.01, -half + 0.01, half - 0.01, half - 0.01)
    )
    box = _placed(shell, middle, rng.uniform(0.0, np.pi))
    width = half * 1.5 + arm.radius + rng.uniform(0.01, 0.06)
    aside = unit_vector(heading + rng.uniform(0.5, 1.0) * rng.choice((-1.0, 1.0)) * np.pi)
    narrow = TipGoal(middle + (width - 0.004) * aside)
    problem = _problem(rng, arm, (Obstacle("box", PlaneShape(box)),), narrow)
    return problem, TipGoal(middle), Tolerances(position=width)
