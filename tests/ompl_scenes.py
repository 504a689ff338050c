"""The problems of OMPL's kinematic chains, for any number of links: horn, corridor, constricted; radius 0, length 1 m.

Numbers from OMPL's public demos: the horn from ``KinematicChain.h`` and ``KinematicChainBenchmark.cpp`` (Gipson, Moll
and Kavraki, "Resolution independent density estimation for motion planning in high-dimensional spaces", ICRA 2013),
corridor and constricted from ``PlanarManipulatorPolyWorld.h`` (Luna, Moll, Badger and Kavraki, "A scalable motion
planner for high-dimensional kinematic systems", IJRR 2020). As in OMPL, the goal of the horn is a pose of the whole
arm, that of the other two a position of the tip.

Two conditions are stricter than in OMPL: bend angles are limited to 119°, so that links two apart cannot cross (OMPL:
180°, with a check of all pairs), and distances below a nanometre count as contact.
"""

from collections.abc import Callable

import numpy as np
import shapely

from ccm_opt.core.arrays import FloatArray
from ccm_opt.problem import JointPose, Limits, PlannerOptions, Problem, TipGoal, Tolerances
from ccm_opt.robot.arm import Arm
from ccm_opt.scene.workspace import Obstacle, PlaneShape, Workspace

BEND_LIMIT = float(np.deg2rad(119.0))
"""Limit of bend angles below 120°, for which two equal links that are two apart cannot meet [rad]."""
BASE_LIMIT = float(2.0 * np.pi)
"""Limit of the first bend angle, as in OMPL [rad]."""
TIP_TOLERANCE = 1e-3
"""Tolerance of tip goals, as in OMPL [m]."""
WORLD = 1.25
"""Width and height of the world of corridor and constricted [m]."""
LARGEST_CORRIDOR = 110
"""Largest even number of links at which the goal of the corridor is not inside a wall."""


def horn(links: int) -> Problem:
    """Return the problem of an arm that has to leave a bent horn and lie straight on the other side of its base."""
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
    """Return the vertices of a wall beside the start pose at an offset ``y`` [m], shape (links, 2) [m].

    The steps have the length (1 - π y) / links, and each is rotated by π / links relative to the previous one.
    """
    turn = np.pi / links * np.arange(1, links)
    steps = (1.0 - np.pi * y) / links * np.stack((np.cos(turn), np.sin(turn)), axis=1)
    first = np.array([[1.0 / links, y]])
    return np.vstack((first, first + np.cumsum(steps, axis=0)))


def corridor(links: int) -> Problem:
    """Return the problem of a straight arm in a low channel whose tip has to move up a shaft between two blocks.

    Raises:
        ValueError: the goal would lie inside a wall.
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
    """Return the problem of a straight arm, half in a narrow slit, whose tip has to move around a shelf."""
    gap = 2.0 * np.log10(links) / links
    slit = 1.0 / links
    blocks = (
        Obstacle("lower block", PlaneShape(_outline(0.0, 0.0, 0.5, 0.5 - slit))),
        Obstacle("upper block", PlaneShape(_outline(0.0, 0.5 + slit, 0.5, WORLD))),
        Obstacle("shelf", PlaneShape(_outline(0.5 + gap, 0.5 + 0.5 * gap, 1.0, 0.5 + gap))),
    )
    return _planar_manipulator(f"constricted-{links}", links, 0.5, blocks, np.array([0.75, 0.5 + 1.5 * gap]))


def _outline(left: float, bottom: float, right: float, top: float) -> shapely.LineString:
    """Return the edge of a rectangle, as a closed wall of zero thickness."""
    return shapely.LineString(shapely.box(left, bottom, right, top).exterior.coords)


def _planar_manipulator(
    name: str, links: int, height: float, blocks: tuple[Obstacle, ...], goal: FloatArray
) -> Problem:
    """Return a problem with the base on the edge of the workspace, straight start and tip goal.

    The first link counts as mount, so that it may touch the edge; OMPL exempts the first point instead.
    """
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
    """Return a problem with high velocity and acceleration limits, since only paths are compared."""
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
