"""Arms wound round a post, and arms whose base stands in a bottle; seeded.

A coil winds outwards round a post next to the base, so that a way out of it is known: joint after joint is
straightened from the tip on. Obstacles stand where that motion does not come. In a bottle the arm lies curled up at
first, and its tip is wanted outside; back in is certainly possible once a way out has been found. The arm is 1 m long.
"""

import numpy as np
import shapely

from ccm_opt.cli.compare.suites import random_headings
from ccm_opt.core.arrays import FloatArray
from ccm_opt.problem import JointPose, Problem, TipGoal
from ccm_opt.robot.arm import Arm
from ccm_opt.scene.workspace import Obstacle, PlaneShape, Workspace
from tests.benchmarks.scene_families import DRAWS, SPARE, NoSceneError, clear, laid_on
from tests.scenes import Scene, make_arm, random_polygon

ROOM = shapely.box(-1.3, -1.3, 1.3, 1.3)
WALL = 0.016
"""Thickness of walls [m]."""
TURNS = (1.0, 1.6)
POLYGONS = 12
"""That are strewn beside the known way."""
UNWINDING = 12
"""Poses of the known way from one joint to the next."""


def wound_up(rng: np.random.Generator, links: int, name: str, time_limit: float) -> Problem:
    """An arm in the open that is to be wound round a post by one turn to 1.6.

    Raises:
        NoSceneError: when none comes of the draw.
    """
    for _ in range(DRAWS):
        arm = make_arm(links, float(rng.uniform(0.006, 0.014)))
        side = float(rng.choice((-1.0, 1.0)))
        pitch = rng.uniform(2.6, 4.5) * arm.radius
        turns = rng.uniform(*TURNS)
        coil, centre, inner = _coil(arm, side, pitch, turns)
        post = Obstacle("post", PlaneShape(shapely.Point(centre), inner - arm.radius - rng.uniform(0.004, 0.02)))
        if post.rounding < 0.01:
            continue
        headings = laid_on(arm, coil)
        way = unwound(arm, headings, int(rng.integers(0, 3)))
        if not all(clear(arm, Workspace(ROOM, (post,)), pose) for pose in way):
            continue
        workspace = Workspace(ROOM, (post, *_beside(rng, arm, way)))
        return Scene(arm, workspace, way[-1], headings).problem(JointPose(arm.bends(headings)), time_limit, name)
    raise NoSceneError("no coil")


def _coil(arm: Arm, side: float, pitch: float, turns: float) -> tuple[FloatArray, FloatArray, float]:
    """A line that winds outwards from the base, its centre, and its inner radius [m]."""
    # As long as the arm: ∫ (r + pitch θ / 2π) dθ over all turns.
    angle = 2.0 * np.pi * turns
    inner = (1.02 * arm.length - 0.5 * pitch * angle * turns) / angle
    theta = np.linspace(0.0, 1.05 * angle, 400)
    radius = inner + pitch * theta / (2.0 * np.pi)
    centre = np.array([0.0, side * inner])
    spokes = np.stack((np.sin(theta), -side * np.cos(theta)), axis=1)
    return centre + radius[:, None] * spokes, centre, float(inner)


def unwound(arm: Arm, headings: FloatArray, left: int) -> list[FloatArray]:
    """Poses in which joint after joint is straight from the tip on, all but the first few; the coil first.

    Args:
        arm: the arm.
        headings: of the coil, shape (links,) [rad].
        left: joints that stay bent.
    """
    bends = arm.bends(headings)
    poses = [headings]
    for joint in range(arm.links - 1, left, -1):
        for share in np.linspace(1.0, 0.0, UNWINDING + 1)[1:]:
            straightened = bends.copy()
            straightened[joint + 1 :] = 0.0
            straightened[joint] *= share
            poses.append(arm.headings(straightened))
    return poses


def _beside(rng: np.random.Generator, arm: Arm, way: list[FloatArray]) -> tuple[Obstacle, ...]:
    """Random polygons that keep off a motion."""
    trace = shapely.union_all(shapely.linestrings(arm.joint_positions(np.array(way))))
    polygons = (random_polygon(rng, rng.uniform(-1.2, 1.2, 2)) for _ in range(POLYGONS))
    # Between two poses the tip moves by less than this.
    apart = arm.radius + SPARE + arm.length * arm.joint_limit / UNWINDING / 2.0
    kept = [polygon for polygon in polygons if shapely.distance(polygon, trace) > apart]
    return tuple(Obstacle(f"polygon {k + 1}", PlaneShape(polygon)) for k, polygon in enumerate(kept))


def out_of_bottle(rng: np.random.Generator, links: int, name: str, time_limit: float) -> Problem:
    """An arm curled up in a bottle, its base inside, whose tip is wanted outside.

    Raises:
        NoSceneError: when none comes of the draw.
    """
    for _ in range(DRAWS):
        arm = make_arm(links, float(rng.uniform(0.01, 0.018)))
        belly = rng.uniform(0.2, 0.32)
        neck = 0.5 * rng.uniform(2.6, 4.5) * arm.radius
        long = rng.uniform(0.03, 0.15)
        base_to_neck = rng.uniform(0.25, 0.4)
        lift = rng.uniform(-0.4, 0.4) * belly
        left = base_to_neck - 2.0 * belly
        if left > -0.08:
            continue
        workspace = Workspace(ROOM, _bottle(belly, neck, long, (left, base_to_neck), lift))
        mouth = base_to_neck + long
        straight = np.array([[0.0, 0.0], [base_to_neck - 0.05, lift], [mouth + 0.05, lift], [2.0, lift]])
        goal = laid_on(arm, straight)
        inside = shapely.box(left + 0.02, -belly + 0.02, base_to_neck - 0.02, belly - 0.02)
        start = _curled(rng, arm, workspace, inside)
        if start is None or not clear(arm, workspace, goal):
            continue
        tip = arm.joint_positions(goal)[-1]
        wanted = TipGoal(tip - np.array([rng.uniform(0.0, 0.2), 0.0]), heading=float(goal[-1]))
        return Scene(arm, workspace, start, goal).problem(wanted, time_limit, name)
    raise NoSceneError("the arm does not fit into the bottle")


def _bottle(belly: float, neck: float, long: float, ends: tuple[float, float], lift: float) -> tuple[Obstacle, ...]:
    """A square belly with a neck at its right."""
    left, right = ends
    half = neck + 0.5 * WALL
    upper = [[left, belly], [right, belly], [right, lift + half], [right + long, lift + half]]
    lower = [[right + long, lift - half], [right, lift - half], [right, -belly], [left, -belly]]
    walls = {"shoulder": upper, "foot": lower, "bottom": [[left, -belly], [left, belly]]}
    return tuple(
        Obstacle(
            name,
            PlaneShape(shapely.buffer(shapely.LineString(line), 0.5 * WALL, cap_style="square", join_style="mitre")),
        )
        for name, line in walls.items()
    )


def _curled(rng: np.random.Generator, arm: Arm, workspace: Workspace, inside: shapely.Geometry) -> FloatArray | None:
    """A random pose that lies wholly inside; None when none is drawn."""
    for _ in range(DRAWS):
        headings = random_headings(rng, arm, rng.uniform(1.0, 4.0))
        # What has to fit into half its length turns once or more.
        headings = headings + rng.choice((-1.0, 1.0)) * np.linspace(0.0, rng.uniform(4.5, 9.0), arm.links)
        axis = shapely.LineString(arm.joint_positions(headings))
        if inside.contains(axis) and clear(arm, workspace, headings):
            return headings
    return None
