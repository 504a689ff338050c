"""Random scenes of an arm on a feed axis in families, seeded; all have a reference that owes nothing to the planner.

Arms of 1 m, 40 mm thick, of twenty links unless said otherwise, come through a hole into a room of 1.2 m by 2.2 m.
References are curves with curvature drawn at five places; polygons of 30–90 mm are strewn where no reference comes
nearer than 10 mm. Joint limits are such that arms of any number of links curve as much.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import shapely

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.polyline import unit_vector
from ccm_opt.planning.leader import LeaderPath, pose_on_path
from ccm_opt.problem import JointPose, Problem, TipGoal, Tolerances
from ccm_opt.robot.arm import Arm
from ccm_opt.scene.workspace import Obstacle, PlaneShape, Workspace
from tests.feed_scenes import LINK, RADIUS, fed_arm, make_problem, make_room
from tests.scenes import random_polygon

LINKS = 20
"""Of the arms, unless said otherwise."""
HOLE = LINKS * LINK
"""Length of every arm, and of its guide [m]."""
STRAIGHT = 0.12
"""How far references go straight beyond the hole [m]."""
KEPT_OFF = 0.01
TUBE_GAPS = (0.02, 0.01, 0.005)
"""Room on either side of the arm in tubes [m]."""
Family = Callable[[np.random.Generator, int], Problem]
"""Draws a problem for an arm of some links."""


def arm_of(links: int, low: float = 0.0) -> Arm:
    """An arm as long as all others, its joints bending as much to a length; fed from a least feed on [m]."""
    link = HOLE / links
    limit = np.deg2rad(50.0) * link / LINK
    return fed_arm(low, links, link, joint_limit=limit, base_limit=limit)


def way(rng: np.random.Generator, straight: float = STRAIGHT) -> LeaderPath:
    """The feed axis to beyond the hole, then a random curve that keeps off itself and the hole's wall."""
    while True:
        arc = np.linspace(0.0, rng.uniform(0.45, 0.8), 801)
        curvature = np.interp(arc, np.linspace(0.0, arc[-1], 5), np.clip(rng.normal(0.0, 4.0, 5), -9.0, 9.0))
        step = arc[1]
        headings = np.concatenate(([0.0], np.cumsum(0.5 * step * (curvature[1:] + curvature[:-1]))))
        middles = 0.5 * (headings[1:] + headings[:-1])
        legs = step * np.column_stack((np.cos(middles), np.sin(middles)))
        points = np.array([straight, 0.0]) + np.concatenate((np.zeros((1, 2)), np.cumsum(legs, axis=0)))
        if keeps_off_itself(points, arc):
            before = np.arange(-0.2, HOLE + straight - 1e-9, 0.02)
            return LeaderPath(
                np.concatenate((before, HOLE + straight + arc)),
                np.concatenate((np.column_stack((before - HOLE, np.zeros(len(before)))), points)),
                np.concatenate((np.zeros(len(before)), headings)),
                HOLE + straight,
            )


def keeps_off_itself(points: FloatArray, arc: FloatArray) -> bool:
    """Whether places far apart along a curve are apart in the room, and all are in the room."""
    some = points[::10]
    at = arc[::10]
    apart = np.linalg.norm(some[:, None] - some[None], axis=2)
    far = np.abs(at[:, None] - at[None]) > 0.2
    return not np.any(far & (apart < 0.08)) and bool(np.all((some[:, 0] > 0.05) & (np.abs(some).max(axis=1) < 1.05)))


def clutter(rng: np.random.Generator, ways: list[LeaderPath]) -> list[Obstacle]:
    """Ten to twenty-five polygons that keep off given ways."""
    lines = shapely.union_all([shapely.LineString(each.points) for each in ways])
    obstacles: list[Obstacle] = []
    count = int(rng.integers(10, 26))
    while len(obstacles) < count:
        polygon = random_polygon(rng, rng.uniform((0.05, -0.95), (1.0, 0.95)))
        if polygon.distance(lines) > RADIUS + KEPT_OFF and polygon.bounds[0] > 0.0:
            obstacles.append(Obstacle(f"polygon {len(obstacles)}", PlaneShape(polygon)))
    return obstacles


def on_way(arm: Arm, path: LeaderPath) -> JointPose:
    """The arm on a way with its tip at the end."""
    feed = path.base_with_tip_at_end(arm.lengths)
    return JointPose(pose_on_path(arm, path, feed), feed)


def tip_of(pose: JointPose, path: LeaderPath) -> TipGoal:
    """Position and heading of the tip of a pose on a way."""
    return TipGoal(path.points[-1], heading=float(pose.bends.sum()))


def into_clutter(rng: np.random.Generator, links: int = LINKS) -> Problem:
    """From the guide to a pose of the tip among polygons."""
    arm = arm_of(links)
    path = way(rng)
    return make_problem(arm, make_room(*clutter(rng, [path])), tip_of(on_way(arm, path), path))


def position_only(rng: np.random.Generator, links: int = LINKS) -> Problem:
    """The same with any heading."""
    arm = arm_of(links)
    path = way(rng)
    return make_problem(arm, make_room(*clutter(rng, [path])), TipGoal(path.points[-1]))


def from_bent(rng: np.random.Generator, links: int = LINKS) -> Problem:
    """From one way to the tip of another: the arm has to be drawn back first."""
    arm = arm_of(links)
    start = way(rng)
    path = way(rng)
    room = make_room(*clutter(rng, [start, path]))
    return make_problem(arm, room, tip_of(on_way(arm, path), path), on_way(arm, start))


def whole_arm(rng: np.random.Generator, links: int = LINKS) -> Problem:
    """From one way to another, the goal given for the whole arm."""
    arm = arm_of(links)
    start = way(rng)
    path = way(rng)
    return make_problem(arm, make_room(*clutter(rng, [start, path])), on_way(arm, path), on_way(arm, start))


def straight_out(rng: np.random.Generator, links: int = LINKS) -> Problem:
    """From a straight arm that already protrudes."""
    arm = arm_of(links)
    path = way(rng)
    feed = rng.uniform(0.2, 0.5)
    out = np.array([-0.2, HOLE + feed])
    ahead = LeaderPath(out, np.column_stack((out - HOLE, np.zeros(2))), np.zeros(2), HOLE + feed)
    start = JointPose(np.zeros(links), feed)
    return make_problem(arm, make_room(*clutter(rng, [path, ahead])), tip_of(on_way(arm, path), path), start)


def short_range(rng: np.random.Generator, links: int = LINKS) -> Problem:
    """From one way to the tip of another with a feed too short to draw the arm back: it changes shape on the way."""
    arm = arm_of(links, float(rng.uniform(0.3, 0.4)))
    start = way(rng)
    path = way(rng)
    room = make_room(*clutter(rng, [start, path]))
    return make_problem(arm, room, tip_of(on_way(arm, path), path), on_way(arm, start))


def tube(gap: float) -> Family:
    """From the guide through a curved tube with a given room on either side of the arm, to near its end."""

    def drawn(rng: np.random.Generator, links: int = LINKS) -> Problem:
        arm = arm_of(links)
        path = way(rng)
        return make_problem(arm, make_room(*tube_around(path, gap)), tip_of(on_way(arm, path), path))

    return drawn


def tube_around(path: LeaderPath, gap: float) -> list[Obstacle]:
    """Walls of a tube around a way from the hole to beyond its end, with a given room on either side of the arm [m]."""
    beyond = path.points[-1] + 0.08 * np.array([np.cos(path.headings[-1]), np.sin(path.headings[-1])])
    line = shapely.LineString(np.vstack((path.points[path.arc > HOLE + 0.01], beyond)))
    inside = shapely.buffer(line, RADIUS + gap, cap_style="flat", quad_segs=16)
    shell = shapely.buffer(line, RADIUS + gap + 0.02, cap_style="flat").difference(inside)
    parts = shapely.get_parts(shapely.simplify(shell, 2e-4))
    return [Obstacle(f"tube {k}", PlaneShape(part)) for k, part in enumerate(parts) if part.area > 1e-5]


def tight_guide(rng: np.random.Generator, links: int = LINKS) -> Problem:
    """From a guide and through a plate with hardly any play, or none, among polygons."""
    arm = arm_of(links)
    path = way(rng)
    play = float(rng.choice((0.0, 1e-4, 1e-3)))
    plate = float(rng.uniform(0.01, 0.05))
    walls = [
        Obstacle("guide, above", PlaneShape(shapely.box(-1.2, RADIUS + play, plate, 1.0))),
        Obstacle("guide, below", PlaneShape(shapely.box(-1.2, -1.0, plate, -RADIUS - play))),
    ]
    room = make_room(*clutter(rng, [path]))
    beyond = tuple(each for each in room.obstacles if not each.name.startswith("guide"))
    return make_problem(arm, Workspace(room.boundary, (*walls, *beyond)), tip_of(on_way(arm, path), path))


def turning(straight: float, radius: float, turn: float, onward: float) -> LeaderPath:
    """The feed axis to some way beyond the hole, an arc of a given radius [m] and turn [rad], and straight on [m]."""
    arc = np.linspace(0.0, abs(turn) * radius + onward, 601)
    headings = np.sign(turn) * np.minimum(arc / radius, abs(turn))
    middles = 0.5 * (headings[1:] + headings[:-1])
    legs = arc[1] * np.column_stack((np.cos(middles), np.sin(middles)))
    points = np.array([straight, 0.0]) + np.concatenate((np.zeros((1, 2)), np.cumsum(legs, axis=0)))
    before = np.arange(-0.2, HOLE + straight - 1e-9, 0.02)
    return LeaderPath(
        np.concatenate((before, HOLE + straight + arc)),
        np.concatenate((np.column_stack((before - HOLE, np.zeros(len(before)))), points)),
        np.concatenate((np.zeros(len(before)), headings)),
        HOLE + straight,
    )


def behind_the_entrance(rng: np.random.Generator, links: int = LINKS) -> Problem:
    """Through the hole, round by half a turn, and back towards the wall in which the hole is."""
    arm = arm_of(links)
    radius = float(rng.uniform(0.12, 0.2))
    path = turning(STRAIGHT + 0.1, radius, float(rng.choice((-np.pi, np.pi))), 0.05)
    return make_problem(arm, make_room(*clutter(rng, [path])), tip_of(on_way(arm, path), path))


def elbow(rng: np.random.Generator, links: int = LINKS) -> Problem:
    """Through an elbow of a pipe beyond the hole, to a place in the pipe behind it."""
    arm = arm_of(links)
    turn = float(rng.choice((-1.0, 1.0)) * np.deg2rad(rng.choice((45.0, 60.0, 90.0))))
    path = turning(
        float(rng.uniform(STRAIGHT, 0.3)), float(rng.uniform(0.12, 0.2)), turn, float(rng.uniform(0.05, 0.25))
    )
    return make_problem(arm, make_room(*tube_around(path, 0.015)), tip_of(on_way(arm, path), path))


def tank(rng: np.random.Generator, links: int = LINKS) -> Problem:
    """Into a tank that is closed but for its hole, to a place on one side of the entrance or behind it."""
    arm = arm_of(links)
    turn = float(rng.choice((-1.0, 1.0)) * rng.uniform(np.deg2rad(70.0), np.deg2rad(160.0)))
    path = turning(
        float(rng.uniform(STRAIGHT, 0.3)), float(rng.uniform(0.12, 0.18)), turn, float(rng.uniform(0.0, 0.1))
    )
    beyond = path.points[path.points[:, 0] > 0.0]
    room = RADIUS + float(rng.uniform(0.02, 0.06))
    inside = shapely.box(0.0, beyond[:, 1].min() - room, beyond[:, 0].max() + room, beyond[:, 1].max() + room)
    shell = inside.buffer(0.02, join_style="mitre").difference(inside)
    # The wall in which the hole is belongs to the room.
    walls = shapely.difference(shell, shapely.box(-1.0, -2.0, 0.0, 2.0))
    return make_problem(arm, make_room(Obstacle("tank", PlaneShape(walls))), TipGoal(path.points[-1]))


def widened(problem: Problem, rng: np.random.Generator) -> Problem:
    """The problem with a disc and a range of headings that hold its goal, their middle anywhere, walls included."""
    goal = problem.goal
    assert isinstance(goal, TipGoal)
    width = float(rng.uniform(0.02, 0.2))
    turn = float(rng.uniform(0.1, 1.5))
    # What the planner keeps back of a tolerance is left out, so that the narrow goal is in the set.
    middle = goal.position + 0.9 * width * rng.uniform() * unit_vector(rng.uniform(-np.pi, np.pi))
    heading = None if goal.heading is None else goal.heading + 0.9 * turn * rng.uniform(-1.0, 1.0)
    return replace(problem, goal=TipGoal(middle, heading=heading), tolerances=Tolerances(width, turn))


FAMILIES: dict[str, Family] = {
    "into clutter": into_clutter,
    "position only": position_only,
    "from bent": from_bent,
    "whole arm": whole_arm,
    "straight out": straight_out,
    "short range": short_range,
} | {f"tube, {1e3 * gap:g} mm": tube(gap) for gap in TUBE_GAPS}
FAMILIES |= {"tight guide": tight_guide, "behind the entrance": behind_the_entrance, "elbow": elbow, "tank": tank}
