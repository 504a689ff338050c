"""Random planar problems that are barely feasible: narrow gates, joints at their limits, starts in contact.

The goal pose of each problem is made without the planner: on the centre line of the doors, or with joints at their
limits. The arm is 1 m long; number of links, radius, limits, width of doors and kind of goal are random.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import shapely
import shapely.affinity

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.polyline import unit_vector
from ccm_opt.problem import JointPose, Problem, TipGoal
from ccm_opt.robot.arm import Arm
from ccm_opt.scene.workspace import Obstacle, PlaneShape, Workspace
from tests.benchmarks.scene_families import NoSceneError, laid_on
from tests.scenes import Scene, make_arm, random_headings, self_gap, wall_gaps

LINKS = (8, 12, 16, 24, 30, 36, 48)
PLAYS = (1.02, 1.03, 1.05)
"""Ratios of the width of a gate to the width of the arm."""
ROOM = shapely.box(-1.4, -1.4, 1.5, 1.4)
DRAWS = 200
KEPT_OFF = 0.02
"""Minimum distance of random poses from walls and from the arm itself, apart from intended contacts [m]."""
AT_LIMIT = 0.999
"""Fraction of the joint limit to which joints of a stiff arm are bent."""
WHOLE_ARM = 0.15
POSITION_ONLY = 0.3
"""Fractions of the goals that are poses of the whole arm, and that are tip positions without heading."""


def edge_problem(family: str, seed: int, time_limit: float = 20.0) -> Problem:
    """Return the random problem of a family for a seed.

    Raises:
        NoSceneError: no valid problem is found for this seed.
    """
    rng = np.random.default_rng([seed, tuple(EDGES).index(family), 12])
    links = LINKS[seed % len(LINKS)]
    scene = EDGES[family](rng, links)
    kind = rng.random()
    goal: TipGoal | JointPose = scene.goal_tip
    if kind < WHOLE_ARM:
        goal = JointPose(scene.arm.bends(scene.goal))
    elif kind < WHOLE_ARM + POSITION_ONLY:
        goal = TipGoal(scene.goal_tip.position)
    return scene.problem(goal, time_limit, f"{family}-{links}-{seed}")


def gate(rng: np.random.Generator, links: int) -> Scene:
    """Return a scene with one gate slightly wider than the arm, and a start that points away from the gate."""
    x = rng.uniform(0.25, 0.5)
    thick = float(rng.choice((0.0, 0.01, 0.02, 0.04)))
    return turned(_behind_doors(rng, links, [x], [thick], 1.4), rng.uniform(-np.pi, np.pi))


def doors(rng: np.random.Generator, links: int) -> Scene:
    """Return a scene with two or three doors in a row in a corridor."""
    count = int(rng.integers(2, 4))
    x = 0.25 + 0.35 * np.arange(count) + rng.uniform(-0.03, 0.03, count)
    return turned(_behind_doors(rng, links, list(x), [0.02] * count, 0.45), rng.uniform(-np.pi, np.pi))


def turned(scene: Scene, angle: float) -> Scene:
    """Return a scene rotated about the base by an angle [rad], so that no wall is parallel to an axis."""
    boundary = shapely.affinity.rotate(scene.workspace.boundary, angle, origin=(0.0, 0.0), use_radians=True)
    obstacles = tuple(
        replace(
            each,
            shape=PlaneShape(
                shapely.affinity.rotate(each.core, angle, origin=(0.0, 0.0), use_radians=True), each.rounding
            ),
        )
        for each in scene.workspace.obstacles
    )
    arm = replace(scene.arm, base_heading=scene.arm.base_heading + angle)
    return Scene(arm, Workspace(boundary, obstacles), scene.start + angle, scene.goal + angle)


def _behind_doors(rng: np.random.Generator, links: int, x: list[float], thick: list[float], high: float) -> Scene:
    """Return a scene with an arm that has to pass doors at random heights.

    Args:
        rng: random generator.
        links: number of links.
        x: positions of the doors along x [m].
        thick: thicknesses of the doors [m].
        high: half the height of the workspace [m].
    """
    for _ in range(DRAWS):
        radius = rng.uniform(0.012, 0.022)
        arm = make_arm(links, radius, base_limit=np.pi)
        # The arm is straight within a door, for which it needs a link before and after the door.
        straight = 1.2 * arm.link_length + 0.5 * max(thick)
        room_to_turn = links >= 16
        y = rng.uniform(-0.08, 0.08, len(x)) if room_to_turn else np.zeros(len(x))
        half = float(rng.choice(PLAYS)) * radius
        shape = SHAPES[int(rng.integers(len(SHAPES)))]
        line = np.linspace(0.0, 2.0, 401)
        places = [at + side * straight for at in x for side in (-1.0, 1.0)]
        wave = np.interp(line, [0.0, *places, 3.0], [0.0, *np.repeat(y, 2), y[-1]])
        centre = np.stack((line, wave), axis=1)
        obstacles = tuple(
            jamb
            for k, (at, width, b) in enumerate(zip(x, thick, y, strict=True))
            for name, side in (("top", 1.0), ("bottom", -1.0))
            for jamb in shape(f"door {k + 1}, {name}", at, width, b + side * half, side * high)
        )
        workspace = Workspace(shapely.box(-1.4, -high, 1.5, high), obstacles)
        goal = laid_on(arm, centre)
        start = np.full(links, rng.choice((-1.0, 1.0)) * np.deg2rad(rng.uniform(150.0, 179.0)))
        # Half the gap of the narrowest door, as straight links come nearer to the jambs of a thick door.
        if _clear(arm, workspace, goal, 0.5 * (half - radius)) and _clear(arm, workspace, start, KEPT_OFF):
            return Scene(arm, workspace, start, goal)
    raise NoSceneError("the arm cannot lie in the doors")


def limit_arc(rng: np.random.Generator, links: int) -> Scene:
    """Return a scene whose goal has joints at their limits, bent to one side or first to one and then to the other."""
    for _ in range(DRAWS):
        turn = rng.uniform(np.deg2rad(40.0), np.deg2rad(280.0))
        arm = make_arm(links, float(rng.choice((0.0, 0.01, 0.02))), joint_limit=turn / links, base_limit=np.pi)
        switch = links if rng.random() < 0.5 else int(rng.integers(1, links))
        side = float(rng.choice((-1.0, 1.0)))
        bends = side * np.where(np.arange(links) < switch, 1.0, -1.0) * AT_LIMIT * arm.joint_limit
        start = np.zeros(links)
        # A third of the arms start at the opposite limits.
        if rng.random() < 1.0 / 3.0:
            start = arm.headings(-bends)
        bends[0] = rng.uniform(-2.0, 2.0) if rng.random() < 0.5 else bends[0]
        goal = arm.headings(bends)
        if all(self_gap(arm, arm.joint_positions(pose)) > KEPT_OFF for pose in (start, goal)):
            return Scene(arm, Workspace(ROOM), start, goal)
    raise NoSceneError("the arm lies on itself")


def limit_arc_among(rng: np.random.Generator, links: int) -> Scene:
    """Return a scene of ``limit_arc`` with up to five posts that do not touch start and goal pose."""
    scene = limit_arc(rng, links)
    arm = scene.arm
    poses = shapely.multilinestrings([arm.joint_positions(pose) for pose in (scene.start, scene.goal)])
    posts: list[Obstacle] = []
    for _ in range(40):
        post = shapely.Point(rng.uniform(-1.0, 1.0, 2))
        rounding = rng.uniform(0.02, 0.06)
        if shapely.distance(post, poses) > arm.radius + rounding + KEPT_OFF and len(posts) < 5:
            posts.append(Obstacle(f"post {len(posts) + 1}", PlaneShape(post, rounding)))
    return replace(scene, workspace=Workspace(ROOM, tuple(posts)))


def at_wall(rng: np.random.Generator, links: int) -> Scene:
    """Return a scene whose start touches the flat side of a wall with one of the outer links or the tip."""
    return _touching(rng, links, sharp=False)


def at_corner(rng: np.random.Generator, links: int) -> Scene:
    """Return a scene whose start touches the corner of a wall."""
    return _touching(rng, links, sharp=True)


def _touching(rng: np.random.Generator, links: int, *, sharp: bool) -> Scene:
    """Return a scene with a random start in contact with a wall, and a random goal.

    Args:
        rng: random generator.
        links: number of links.
        sharp: whether the arm touches a corner of the wall instead of a side.
    """
    for _ in range(DRAWS):
        arm = make_arm(links, rng.uniform(0.012, 0.025))
        start = random_headings(rng, arm, 2.5)
        goal = random_headings(rng, arm, 2.5)
        points = arm.joint_positions(start)
        if any(self_gap(arm, arm.joint_positions(pose)) < KEPT_OFF for pose in (start, goal)):
            continue
        link = int(rng.integers(links // 3, links))
        place = points[link] + rng.uniform(0.2, 0.8) * (points[link + 1] - points[link])
        side = float(rng.choice((-1.0, 1.0)))
        away = unit_vector(start[link] + side * 0.5 * np.pi)
        touching = _pushed_up_to(_wall_towards(rng, place, away, sharp=sharp), away, points, arm.radius)
        base_gap = shapely.distance(touching, shapely.Point(arm.base))
        workspace = Workspace(ROOM, (Obstacle("wall", PlaneShape(touching)),))
        if base_gap > 0.1 and _clear(arm, workspace, goal, KEPT_OFF) and _clear(arm, workspace, start, -1e-9):
            return Scene(arm, workspace, start, goal)
    raise NoSceneError("no pose")


def _pushed_up_to(wall: shapely.Polygon, away: FloatArray, points: FloatArray, apart: float) -> shapely.Polygon:
    """Return a wall translated until its distance from the axis of an arm has a given value.

    Args:
        wall: the wall.
        away: direction of the translation, away from the arm, shape (2,).
        points: vertices of the arm's axis, shape (k, 2) [m].
        apart: the distance [m].
    """
    axis = shapely.LineString(points)
    near = 0.0
    far = 0.5
    for _ in range(60):
        middle = 0.5 * (near + far)
        off = shapely.distance(shapely.affinity.translate(wall, *(middle * away)), axis)
        near, far = (near, middle) if off >= apart else (middle, far)
    return shapely.affinity.translate(wall, *(far * away))


def _wall_towards(rng: np.random.Generator, place: FloatArray, away: FloatArray, *, sharp: bool) -> shapely.Polygon:
    """Return a random convex wall that lies beyond a point in a direction, with a corner or a side at the point."""
    along = np.array([-away[1], away[0]])
    wide = rng.uniform(0.05, 0.2)
    deep = rng.uniform(0.05, 0.3)
    if sharp:
        back = place + deep * away
        return shapely.Polygon([place, back + wide * along, back - wide * along])
    corners = [place + s * wide * along + d * away for s, d in ((-1, 0), (1, 0), (1, deep), (-1, deep))]
    return shapely.Polygon(corners)


def _clear(arm: Arm, workspace: Workspace, headings: FloatArray, least: float) -> bool:
    """Return whether a pose respects the joint limits and has a minimum distance [m] from walls and from itself."""
    points = arm.joint_positions(headings)
    if np.any(np.abs(arm.bends(headings)) > arm.bend_limits):
        return False
    return float(wall_gaps(arm, workspace, points).min()) >= least and self_gap(arm, points) > min(KEPT_OFF, 0.01)


def _flat(name: str, x: float, thick: float, low: float, high: float) -> tuple[Obstacle, ...]:
    """Return a rectangular wall across a corridor from one height to another; a line if the thickness is zero."""
    if thick == 0.0:
        return (Obstacle(name, PlaneShape(shapely.LineString([(x, low), (x, high)]))),)
    return (Obstacle(name, PlaneShape(shapely.box(x - 0.5 * thick, min(low, high), x + 0.5 * thick, max(low, high)))),)


def _pointed(name: str, x: float, thick: float, low: float, high: float) -> tuple[Obstacle, ...]:
    """Return a triangular wall whose tip is at the height ``low``."""
    half = 0.5 * thick + 0.02
    return (Obstacle(name, PlaneShape(shapely.Polygon([(x, low), (x - half, high), (x + half, high)]))),)


def _round(name: str, x: float, thick: float, low: float, high: float) -> tuple[Obstacle, ...]:
    """Return a wall with a round end at the height ``low``."""
    radius = 0.5 * thick + 0.005
    inside = low + np.copysign(radius, high)
    return (Obstacle(name, PlaneShape(shapely.LineString([(x, inside), (x, high)]), radius)),)


SHAPES = (_flat, _pointed, _round)
"""Functions that make the obstacle on one side of a door."""
EDGES: dict[str, Callable[[np.random.Generator, int], Scene]] = {
    "gate": gate,
    "doors": doors,
    "limit-arc": limit_arc,
    "limit-arc-among": limit_arc_among,
    "at-wall": at_wall,
    "at-corner": at_corner,
}
"""Functions that make the scene of a family, by name."""
