"""Fields of many small polygons: one in each cell of a grid, scaled with the cells so that ways exist; seeded.

A start pose drawn at random, and a goal that is the tip of another smooth pose; polygons too near to either are left
out, so that both ends are free. That a way leads from one to the other is likely where ``FieldKind.cleared`` gives the
arm room to double up, and not known for certain. In fields that are *walked* it is: their goal lies where a certified
walk from the start has led the tip, and only polygons that touch the start are left out.
"""

from dataclasses import dataclass, replace

import numpy as np
import shapely

from ccm_opt.core.arrays import FloatArray
from ccm_opt.problem import Problem
from ccm_opt.robot.arm import Arm
from ccm_opt.scene.workspace import Obstacle, PlaneShape, Workspace
from tests.benchmarks.walked_goals import walked
from tests.scenes import Scene, make_arm, random_headings, self_gap

HALF_WIDTH = 1.3
"""Of the square room, the arm's base in its middle [m]."""
RADIUS = 0.125
"""Of the arm, as a share of a cell's width."""
SIZE = (0.1, 0.23)
"""Of the discs that polygons are inscribed in, as shares of a cell's width."""
SHIFT = 0.12
"""Of a polygon's middle from that of its cell, at most, likewise."""


@dataclass(frozen=True)
class FieldKind:
    """What is varied.

    Attributes:
        polygons: cells of the grid, nearly.
        links: of the arm.
        vertices: of each polygon; None for 4 to 7 at random.
        gap: of start and goal poses to polygons, as a share of a cell's width.
        hole: radius of the disc about the base that is kept free, likewise.
        walked: whether the goal lies where a certified walk has led the tip.
    """

    polygons: int
    links: int = 24
    vertices: int | None = None
    gap: float = 0.05
    hole: float = 0.0
    walked: bool = False

    @classmethod
    def cleared(cls, polygons: int) -> "FieldKind":
        """Room for the arm doubled up along both poses, and room to turn at the base."""
        return cls(polygons, gap=0.28, hole=1.2)

    @classmethod
    def known(cls, polygons: int) -> "FieldKind":
        """Goals to which a way is known."""
        return cls(polygons, walked=True)


def polygon_field(seed: int, kind: FieldKind) -> Scene:
    """A start pose, a goal pose and the polygons that leave both free, or the start alone where the goal is walked."""
    rng = np.random.default_rng([seed, kind.polygons])
    scene = _field(rng, kind)
    if not kind.walked:
        return scene
    reached = walked(scene, rng)
    while reached is None:  # a start from which no walk comes far; others do
        reached = walked(_field(rng, kind), rng)
    return reached


def _field(rng: np.random.Generator, kind: FieldKind) -> Scene:
    """Two poses and polygons."""
    cells = round(np.sqrt(kind.polygons))
    width = 2.0 * HALF_WIDTH / cells
    arm = make_arm(kind.links, RADIUS * width)
    start = _pose(rng, arm)
    goal = _pose(rng, arm)
    kept_free = (start,) if kind.walked else (start, goal)
    ends = shapely.multilinestrings([arm.joint_positions(pose) for pose in kept_free])
    shapely.prepare(ends)
    base = shapely.Point(arm.base)

    obstacles = []
    for cell in np.ndindex(cells, cells):
        middle = (np.array(cell) + 0.5) * width - HALF_WIDTH + rng.uniform(-SHIFT, SHIFT, 2) * width
        polygon = _polygon(rng, middle, rng.uniform(*SIZE) * width, kind.vertices)
        clear = not shapely.dwithin(ends, polygon, arm.radius + kind.gap * width)
        if clear and not shapely.dwithin(base, polygon, kind.hole * width):
            obstacles.append(Obstacle(f"polygon {len(obstacles) + 1}", PlaneShape(polygon)))
    room = shapely.box(-HALF_WIDTH, -HALF_WIDTH, HALF_WIDTH, HALF_WIDTH)
    return Scene(arm, Workspace(room, tuple(obstacles)), start, goal)


def field_problem(seed: int, kind: FieldKind, time_limit: float = 60.0) -> Problem:
    """The tip of a field's arm to be brought to its goal pose's place and heading."""
    problem = polygon_field(seed, kind).problem(time_limit=time_limit)
    return replace(problem, name=f"field-{kind.polygons}-{seed}")


def _pose(rng: np.random.Generator, arm: Arm) -> FloatArray:
    """A smooth pose that keeps its limits and does not touch itself."""
    while True:
        headings = random_headings(rng, arm, rng.uniform(1.5, 4.0))
        limits_kept = bool(np.all(np.abs(arm.bends(headings))[1:] < 0.9 * arm.joint_limit))
        if limits_kept and self_gap(arm, arm.joint_positions(headings)) > arm.radius:
            return headings


def _polygon(rng: np.random.Generator, middle: FloatArray, radius: float, vertices: int | None) -> shapely.Polygon:
    """The hull of some points in a disc; with many vertices, a smooth outline with a dent or two."""
    if vertices is None:
        count = int(rng.integers(4, 8))
        angles = rng.uniform(0.0, 2.0 * np.pi, count)
        places = radius * np.sqrt(rng.uniform(0.3, 1.0, count))[:, None]
        hull = shapely.convex_hull(
            shapely.multipoints(middle + places * np.column_stack((np.cos(angles), np.sin(angles))))
        )
        return hull if isinstance(hull, shapely.Polygon) else shapely.Point(middle).buffer(0.5 * radius)
    angles = 2.0 * np.pi * np.arange(vertices) / vertices
    waves = 1.0 + rng.uniform(-0.15, 0.15) * np.cos(3.0 * angles) + rng.uniform(-0.1, 0.1) * np.sin(2.0 * angles)
    return shapely.Polygon(middle + 0.85 * radius * waves[:, None] * np.column_stack((np.cos(angles), np.sin(angles))))
