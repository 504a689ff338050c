"""Scenes with a narrow way in, which an arm enters and then has to leave: the way in, and its reverse; seeded.

Mazes, doors, combs, clutter, bottles and spiral ducts before an arm whose base stands in the open. On the way in the
arm lies in the open and its tip has to get inside; the reverse begins where a verified way in ended, and wants the tip,
its heading too, or the whole arm back where the way in began. So every reverse is known to have a solution. The arm is
1 m long.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import shapely

from ccm_opt.cli.compare.suites import random_headings
from ccm_opt.core.arrays import FloatArray
from ccm_opt.problem import Goal, JointPose, Problem, TipGoal
from ccm_opt.problem.solution import JointTrajectory
from ccm_opt.robot.arm import Arm
from ccm_opt.scene.workspace import Obstacle, PlaneShape, Workspace
from tests.benchmarks.scene_families import DRAWS, SPARE, NoSceneError, clear, smooth
from tests.benchmarks.wound_scenes import out_of_bottle, wound_up
from tests.scenes import Scene, clutter, make_arm

LINKS = (16, 24, 30, 36)
"""Numbers of links that are drawn."""
ROOM = shapely.box(-1.25, -1.25, 1.3, 1.25)
"""Boundary of the scenes [m]."""
WALL = 0.016
"""Thickness of walls [m]."""
TIP_DEPTHS = (0.75, 0.93)
"""Least and greatest way from the base to the goal, as shares of the arm's length."""
BACKWARDS = np.pi
"""Where the arm points before the way in: away from the walls [rad]."""


@dataclass(frozen=True)
class Inside:
    """Walls and the line on which an arm lies that has entered.

    Attributes:
        obstacles: the walls.
        centre: polyline from the base into the walls, shape (k, 2) [m].
        depth: arc length on the line that the tip reaches at most [m].
    """

    obstacles: tuple[Obstacle, ...]
    centre: FloatArray
    depth: float


def _sheets(legs: list[tuple[FloatArray, FloatArray]], name: str) -> tuple[Obstacle, ...]:
    """Walls of some thickness along straight legs."""
    lines = [shapely.LineString([a, b]) for a, b in legs]
    return tuple(
        Obstacle(f"{name} {k + 1}", PlaneShape(shapely.buffer(line, 0.5 * WALL, cap_style="square")))
        for k, line in enumerate(lines)
    )


def maze(rng: np.random.Generator, _: Arm) -> Inside:
    """A maze of square cells, entered in the middle of its near side; the line leads to a random cell."""
    cells = int(rng.choice((3, 4)))
    pitch = rng.uniform(0.15, 0.2)
    origin = np.array([rng.uniform(0.1, 0.16), -pitch * (rng.integers(cells) + 0.5)])
    parents = _random_tree(rng, cells, (0, int(np.floor(-origin[1] / pitch))))
    open_sides = {frozenset((child, parent)) for child, parent in parents.items() if parent is not None}

    def corner(i: int, j: int) -> FloatArray:
        return origin + pitch * np.array([i, j], dtype=np.float64)

    entrance = next(cell for cell, parent in parents.items() if parent is None)
    legs = []
    for i in range(cells + 1):
        for j in range(cells):
            closed = frozenset(((i - 1, j), (i, j))) not in open_sides
            if closed and (i, j) != entrance:
                legs.append((corner(i, j), corner(i, j + 1)))
            if frozenset(((j, i - 1), (j, i))) not in open_sides:
                legs.append((corner(j, i), corner(j + 1, i)))

    way = _longest_way(parents, rng)
    middles = [corner(*cell) + 0.5 * pitch for cell in way]
    line = np.vstack(([0.0, 0.0], [origin[0], middles[0][1]], *middles))
    centre = smooth(line, 0.45 * pitch)
    return Inside(_sheets(legs, "maze wall"), centre, float(shapely.LineString(centre).length) - 0.2 * pitch)


Cell = tuple[int, int]


def _random_tree(rng: np.random.Generator, cells: int, root: Cell) -> dict[Cell, Cell | None]:
    """A spanning tree of the cells, depth first: each cell's parent."""
    parents: dict[Cell, Cell | None] = {root: None}
    stack = [root]
    while stack:
        i, j = stack[-1]
        near = [(i + 1, j), (i - 1, j), (i, j + 1), (i, j - 1)]
        new = [c for c in near if min(c) >= 0 and max(c) < cells and c not in parents]
        if new:
            chosen = new[int(rng.integers(len(new)))]
            parents[chosen] = stack[-1]
            stack.append(chosen)
        else:
            stack.pop()
    return parents


def _longest_way(parents: dict[Cell, Cell | None], rng: np.random.Generator) -> list[Cell]:
    """The cells from the root to a random cell that lies 3 to 5 cells deep."""
    ways = []
    for cell in parents:
        way: list[Cell] = []
        at: Cell | None = cell
        while at is not None:
            way.insert(0, at)
            at = parents[at]
        if 3 <= len(way) <= 5:
            ways.append(way)
    return ways[int(rng.integers(len(ways)))]


def doors(rng: np.random.Generator, arm: Arm) -> Inside:
    """Walls across a corridor, each with a door 1.2 to 2 times as wide as the arm."""
    count = int(rng.integers(2, 4))
    x = rng.uniform(0.2, 0.28) + rng.uniform(0.24, 0.3) * np.arange(count)
    y = rng.uniform(-0.1, 0.1, count)
    half = rng.uniform(1.2, 2.0) * arm.radius
    high = rng.uniform(0.35, 0.6)
    legs = []
    for a, b in zip(x, y, strict=True):
        # The sheets' caps reach half a wall's thickness further.
        legs.append((np.array([a, b + half + 0.5 * WALL]), np.array([a, high])))
        legs.append((np.array([a, -high]), np.array([a, b - half - 0.5 * WALL])))
    ends = np.array([-1.2, 1.25])
    legs += [(np.array([ends[0], s * high]), np.array([ends[1], s * high])) for s in (-1.0, 1.0)]
    corners = np.vstack(([0.0, 0.0], *([a + s * 0.04, b] for a, b in zip(x, y, strict=True) for s in (-1.0, 1.0))))
    centre = smooth(np.vstack((corners, [1.2, y[-1]])), 0.1)
    return Inside(_sheets(legs, "door wall"), centre, 1.2)


def comb(rng: np.random.Generator, _: Arm) -> Inside:
    """Teeth from above and below by turns, between which the way winds."""
    teeth = int(rng.integers(2, 5))
    pitch = rng.uniform(0.13, 0.18)
    x = rng.uniform(0.16, 0.22) + pitch * np.arange(teeth)
    overlap = rng.uniform(0.0, 0.07)
    side = rng.choice((-1.0, 1.0)) * (-1.0) ** np.arange(teeth)
    # Teeth reach beyond the middle by the overlap, the way passes their ends.
    legs = [(np.array([a, s * overlap]), np.array([a, -s * 0.5])) for a, s in zip(x, side, strict=True)]
    legs += [(np.array([x[0], s * 0.5]), np.array([1.25, s * 0.5])) for s in (-1.0, 1.0)]
    turn = 0.5 * pitch
    corners = [[0.0, 0.0]]
    for a, s in zip(x, side, strict=True):
        corners.append([a, s * (overlap + turn)])
    corners.append([x[-1] + 0.5, 0.0])
    return Inside(_sheets(legs, "tooth"), smooth(np.array(corners), 0.5 * pitch), 1.2)


def bottle(rng: np.random.Generator, arm: Arm) -> Inside:
    """A belly behind a narrow neck; the line goes in by the neck and round the belly."""
    neck = rng.uniform(2.6, 4.5) * arm.radius
    mouth = rng.uniform(0.1, 0.25)
    long = rng.uniform(0.06, 0.25)
    belly = rng.uniform(0.15, 0.26)
    side = rng.choice((-1.0, 1.0))
    inner = mouth + long
    half = 0.5 * neck + 0.5 * WALL
    outline = [[mouth, half], [inner, half], [inner, belly], [inner + 2.0 * belly, belly]]
    lower = [[a, -b] for a, b in outline[::-1]]
    ring = np.array(outline + lower)
    legs = list(pairwise(ring))
    # Once round inside, a strand from the wall.
    far = inner + 2.0 * belly
    off = 0.22 * belly
    corners = [
        [0.0, 0.0],
        [inner, 0.0],
        [far - off, 0.0],
        [far - off, side * (belly - off)],
        [inner + off, side * (belly - off)],
        [inner + off, side * 2.0 * off],
    ]
    centre = smooth(np.array(corners), 0.6 * belly)
    return Inside(_sheets(legs, "bottle"), centre, float(shapely.LineString(centre).length))


def spiral(rng: np.random.Generator, arm: Arm) -> Inside:
    """A spiral duct of 1 to 1.6 turns, entered at its outer end."""
    turns = rng.uniform(1.0, 1.6)
    side = rng.choice((-1.0, 1.0))
    width = rng.uniform(3.0, 6.0) * arm.radius
    inner = rng.uniform(1.1, 1.5) * arm.link_length / arm.joint_limit + 0.5 * (width + WALL)
    total = 2.0 * np.pi * turns
    angles = np.linspace(0.0, total, int(total / 0.1))
    radius = inner + (width + WALL) * (total - angles) / (2.0 * np.pi)
    entry = rng.uniform(0.12, 0.2)
    # The spiral begins heading along x, at the foot of its circle, and winds inwards to one side.
    spokes = np.stack((np.sin(angles), -side * np.cos(angles)), axis=1)
    centre = np.array([entry, side * radius[0]])

    def wound(offset: float) -> FloatArray:
        return np.asarray(centre + (radius + offset)[:, None] * spokes)

    outer = wound(0.5 * (width + WALL))
    innermost = wound(-0.5 * (width + WALL))
    last = angles > total - 2.0 * np.pi
    # Between the turns one wall is both the inner of one and the outer of the next.
    walls = (
        Obstacle("outer wall", PlaneShape(shapely.LineString(outer).buffer(0.5 * WALL))),
        Obstacle("inner wall", PlaneShape(shapely.LineString(innermost[last]).buffer(0.5 * WALL))),
    )
    line = np.vstack(([0.0, 0.0], [0.5 * entry, 0.0], wound(0.0)))
    return Inside(walls, line, float(shapely.LineString(line).length) - 0.03)


FAMILIES: dict[str, tuple[Callable[[np.random.Generator, Arm], Inside], tuple[float, float]]] = {
    "maze": (maze, (0.012, 0.02)),
    "doors": (doors, (0.012, 0.02)),
    "comb": (comb, (0.012, 0.02)),
    "bottle": (bottle, (0.01, 0.02)),
    "spiral": (spiral, (0.005, 0.01)),
}
"""Families with the range of their arms' radius [m]."""
CLUTTER = "clutter"
WOUND = {"coil": wound_up, "in-bottle": out_of_bottle}
"""Families whose way in is a way out of a coil, or of a bottle, run backwards."""
NAMES = (*FAMILIES, CLUTTER, *WOUND)


def way_in(family: str, seed: int, time_limit: float = 60.0) -> Problem:
    """A problem that wants the tip inside, by its position and heading.

    Raises:
        NoSceneError: when none comes of the seed.
    """
    rng = np.random.default_rng([seed, NAMES.index(family)])
    links = int(rng.choice(LINKS))
    name = f"{family}-{seed}"
    if family in WOUND:
        return WOUND[family](rng, links, name, time_limit)
    if family == CLUTTER:
        scene = clutter(int(rng.integers(2**31)), int(rng.choice((20, 40, 60))), links)
        return scene.problem(time_limit=time_limit, name=name)
    make, radii = FAMILIES[family]
    for _ in range(DRAWS):
        arm = make_arm(links, float(rng.uniform(*radii)))
        inside = make(rng, arm)
        workspace = Workspace(ROOM, inside.obstacles)
        start = random_headings(rng, arm, 0.6)
        start += BACKWARDS + rng.uniform(-0.1, 0.1) - start[0]
        goal = _goal(arm, workspace, inside, float(rng.uniform(*TIP_DEPTHS)))
        if goal is not None and clear(arm, workspace, start):
            return Scene(arm, workspace, start, start).problem(goal, time_limit, name)
    raise NoSceneError("the tip cannot be inside")


def _goal(arm: Arm, workspace: Workspace, inside: Inside, share: float) -> TipGoal | None:
    """The tip on the line inside, a share of the arm's length from the base; None where it would touch a wall."""
    line = shapely.LineString(inside.centre)
    at = min(inside.depth, share * arm.length)
    ends = np.array([line.interpolate(at - arm.link_length).coords[0], line.interpolate(at).coords[0]])
    need = arm.radius + SPARE
    last = shapely.LineString(ends)
    if min(shapely.distance(last, wall.core) - wall.rounding for wall in workspace.walls) < need:
        return None
    return TipGoal(ends[1], heading=float(np.arctan2(*(ends[1] - ends[0])[::-1])))


def way_out(way: Problem, trajectory: JointTrajectory, kind: str) -> Problem:
    """The reverse of a way in.

    Args:
        way: the way in.
        trajectory: its verified motion.
        kind: "place" wants the tip's place, "tip" its heading too, "arm" the whole arm where the way in began.
    """
    arm = way.arm
    if not isinstance(way.start, JointPose):
        raise TypeError("ways in begin at given joints")
    headings = arm.headings(way.start.bends)
    place = arm.joint_positions(headings)[-1]
    goals: dict[str, Goal] = {
        "place": TipGoal(place),
        "tip": TipGoal(place, heading=float(headings[-1])),
        "arm": way.start,
    }
    start = JointPose(trajectory.bend_angles[-1])
    return replace(way, name=f"{way.name}, back to {kind}", start=start, goal=goals[kind])
