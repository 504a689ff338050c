"""The chains of OMPL as functions of the number of links: horn, corridor and constricted, radius 0, length 1 m.

Numbers from OMPL's public demos: the horn from ``KinematicChain.h`` and ``KinematicChainBenchmark.cpp`` (Gipson, Moll
and Kavraki, "Resolution independent density estimation for motion planning in high-dimensional spaces", ICRA 2013),
corridor and constricted from ``PlanarManipulatorPolyWorld.h`` (Luna, Moll, Badger and Kavraki, "A scalable motion
planner for high-dimensional kinematic systems", IJRR 2020). As there, the horn asks for a whole-arm goal, the other two
for a place of the tip.

Two things are stricter here than there: bends are limited to 119°, so that links two apart cannot cross either (OMPL:
180°, crossings of all pairs are looked for), and distances below a nanometre count as contact.
"""

from collections.abc import Callable

import numpy as np
import shapely

from ccm_opt.core.arrays import FloatArray
from ccm_opt.problem import JointPose, Limits, PlannerOptions, Problem, TipGoal, Tolerances
from ccm_opt.robot.arm import Arm
from ccm_opt.scene.workspace import Obstacle, PlaneShape, Workspace

BEND_LIMIT = float(np.deg2rad(119.0))
"""Two equal links that are two apart cannot meet while the bends between them stay below 120° [rad]."""
BASE_LIMIT = float(2.0 * np.pi)
"""Bound on the first bend, OMPL's own [rad]."""
TIP_TOLERANCE = 1e-3
"""OMPL's threshold for goals of the tip [m]."""
WORLD = 1.25
"""Width and height of the world of corridor and constricted [m]."""
LARGEST_CORRIDOR = 110
"""Largest even number of links at which the goal of the corridor is not inside a wall."""


def horn(links: int) -> Problem:
    """An arm inside a bent horn, to be drawn out and laid straight on the other side of its base."""
    width = 1.0 / links
    room = np.log(links) / links
    walls = (
        Obstacle("outer wall", PlaneShape(shapely.LineString(_bent_wall(links, -room)))),
        Obstacle("inner wall", PlaneShape(shapely.LineString(_bent_wall(links, room)))),
    )
    start = np.full(links, np.pi / links)
    start[0] = 0.0
    goal = np.zeros(links)
    goal[0] = np.pi - 1e-3
    arm = _arm(links, np.zeros(2), mount=0.0)
    workspace = Workspace(shapely.box(-1.0 - width, -1.0 - width, 1.0 + width, 1.0 + width), walls)
    return _problem(f"horn-{links}", arm, workspace, start, JointPose(goal))


def _bent_wall(links: int, y: float) -> FloatArray:
    """A wall beside the start pose: steps of ``(1 - π y) / links``, each turned by π / links more."""
    turn = np.pi / links * np.arange(1, links)
    steps = (1.0 - np.pi * y) / links * np.stack((np.cos(turn), np.sin(turn)), axis=1)
    first = np.array([[1.0 / links, y]])
    return np.vstack((first, first + np.cumsum(steps, axis=0)))


def corridor(links: int) -> Problem:
    """A straight arm in a low channel along the floor, whose tip is to climb a shaft between two blocks.

    Raises:
        ValueError: when the goal would lie inside a wall.
    """
    if links > LARGEST_CORRIDOR:
        raise ValueError(f"got {links} links, expected at most {LARGEST_CORRIDOR}: the goal would lie inside a wall")
    gap = (1.1 * np.pi + np.log(links) / links) / links
    blocks = (
        Obstacle("left block", PlaneShape(_outline(0.0, gap, 0.5 * WORLD - gap, WORLD - gap))),
        Obstacle("right block", PlaneShape(_outline(0.5 * WORLD, gap, WORLD, WORLD - gap))),
    )
    goal = np.array([0.95 * 0.5 * WORLD, min(4.0 * gap, 0.5)])
    return _planar_manipulator(f"corridor-{links}", links, 0.5 * gap, blocks, goal)


def constricted(links: int) -> Problem:
    """A straight arm half in a slit two links high, whose tip is to go round the end of a shelf."""
    gap = 2.0 * np.log10(links) / links
    slit = 1.0 / links
    blocks = (
        Obstacle("lower block", PlaneShape(_outline(0.0, 0.0, 0.5, 0.5 - slit))),
        Obstacle("upper block", PlaneShape(_outline(0.0, 0.5 + slit, 0.5, WORLD))),
        Obstacle("shelf", PlaneShape(_outline(0.5 + gap, 0.5 + 0.5 * gap, 1.0, 0.5 + gap))),
    )
    return _planar_manipulator(f"constricted-{links}", links, 0.5, blocks, np.array([0.75, 0.5 + 1.5 * gap]))


def _outline(left: float, bottom: float, right: float, top: float) -> shapely.LineString:
    """The edge of a box as a wall without thickness."""
    return shapely.LineString(shapely.box(left, bottom, right, top).exterior.coords)


def _planar_manipulator(
    name: str, links: int, height: float, blocks: tuple[Obstacle, ...], goal: FloatArray
) -> Problem:
    """The base stands on the world's edge, so the first link counts as mount; OMPL exempts its first point."""
    arm = _arm(links, np.array([0.0, height]), mount=1.0 / links)
    return _problem(name, arm, Workspace(shapely.box(0.0, 0.0, WORLD, WORLD), blocks), np.zeros(links), TipGoal(goal))


def _arm(links: int, base: FloatArray, mount: float) -> Arm:
    one = np.ones(links) / links
    return Arm(
        links=links,
        link_length=1.0 / links,
        radius=0.0,
        base=base,
        base_heading=0.0,
        joint_limit=BEND_LIMIT,
        base_limit=BASE_LIMIT,
        self_collision=True,
        mount_length=mount,
        masses=one,
        inertia_axial=1e-6 * one,
        inertia_transverse=one / 12.0 / links**2,
    )


def _problem(name: str, arm: Arm, workspace: Workspace, start: FloatArray, goal: TipGoal | JointPose) -> Problem:
    """Limits are generous: the comparison is of paths."""
    limits = Limits(np.full(3 * arm.links, 5.0), np.full(3 * arm.links, 50.0))
    return Problem(
        name,
        workspace,
        arm,
        limits,
        JointPose(start),
        goal,
        tolerances=Tolerances(position=TIP_TOLERANCE),
        planner=PlannerOptions(time_limit=20.0),
    )


SCENES: dict[str, Callable[[int], Problem]] = {"horn": horn, "corridor": corridor, "constricted": constricted}
