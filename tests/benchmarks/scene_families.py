"""Random scenes in families: ducts, U-turns, slaloms, gates, and clutter round a known motion; seeded.

Every scene has a reference that owes nothing to the planner. Goal poses are an arm laid joint by joint on the centre
line of its passage, start poses are drawn until shapely finds nothing in their way; the clutter is strewn where a
known motion does not come. The arm is 1 m long; links, radius, joint limit, kind of goal and dimensions are drawn.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
import shapely

from ccm_opt.core.arrays import FloatArray
from ccm_opt.problem import JointPose, Problem, TipGoal
from ccm_opt.robot.arm import Arm
from ccm_opt.scene.workspace import Obstacle, PlaneShape, Workspace
from tests.scenes import Scene, make_arm, random_headings, random_polygon, self_gap, swept, wall_gaps

LINKS = (4, 6, 8, 10, 12, 14, 16, 20, 30, 60, 120, 200)
ROOM = shapely.box(-1.25, -1.25, 1.35, 1.25)
SPARE = 4e-3
"""Least gap of start and goal poses to walls and to the arm itself [m]."""
POSES = 50
"""Poses of a known motion that are looked at for self-contact."""
DRAWS = 300
"""Poses or dimensions that are drawn before a scene is given up."""
WHOLE_ARM = 0.15
POSITION_ONLY = 0.2
"""Share of goals for the whole arm, and for the tip's position alone."""


class NoSceneError(Exception):
    """No scene of a family came out of a seed: dimensions and arm did not go together."""


@dataclass(frozen=True)
class Layout:
    """Walls with the way that the arm lies on at the goal.

    Attributes:
        obstacles: the walls.
        centre: polyline from the base, longer than the arm, shape (k, 2) [m].
        room: where the start pose has to be, or None.
    """

    obstacles: tuple[Obstacle, ...]
    centre: FloatArray
    room: shapely.Geometry | None = None


def random_arm(rng: np.random.Generator, links: int, widest: float) -> Arm:
    """An arm of some links; its radius is 0, or up to ``widest`` [m]."""
    radius = float(rng.choice((0.0, 0.3, 0.6, 1.0))) * widest
    limit = np.deg2rad(float(rng.choice((45.0, 60.0, 90.0))))
    return make_arm(links, radius, joint_limit=limit)


def laid_on(arm: Arm, centre: FloatArray) -> FloatArray:
    """Link headings of the arm whose joints lie on a line one after the other, shape (links,) [rad]."""
    line = shapely.LineString(centre)
    arc = 0.0
    at = centre[0]
    headings = []
    for _ in range(arm.links):
        arc = _next_arc(line, arc, at, arm.link_length)
        place = np.array(line.interpolate(arc).coords[0])
        headings.append(np.arctan2(*(place - at)[::-1]))
        at = at + arm.link_length * np.array([np.cos(headings[-1]), np.sin(headings[-1])])
    return np.unwrap(headings)


def _next_arc(line: shapely.LineString, arc: float, at: FloatArray, step: float) -> float:
    """The first place on a line, beyond an arc length, at a distance from a point; by bisection [m]."""
    high = arc + step
    while np.hypot(*(np.array(line.interpolate(high).coords[0]) - at)) < step and high < line.length:
        high += 0.05 * step
    low = max(arc, high - 0.05 * step)
    for _ in range(50):
        middle = 0.5 * (low + high)
        near = np.hypot(*(np.array(line.interpolate(middle).coords[0]) - at)) < step
        low, high = (middle, high) if near else (low, middle)
    return high


def clear(arm: Arm, workspace: Workspace, headings: FloatArray) -> bool:
    """Whether a pose keeps limits, walls and itself."""
    points = arm.joint_positions(headings)
    if np.any(np.abs(arm.bends(headings))[1:] > 0.97 * arm.joint_limit):
        return False
    if float(wall_gaps(arm, workspace, points).min()) < SPARE:
        return False
    return not arm.self_collision or self_gap(arm, points) > SPARE


def drawn_start(rng: np.random.Generator, arm: Arm, workspace: Workspace, room: shapely.Geometry | None) -> FloatArray:
    """A random smooth pose that touches nothing, within a part of the room.

    Raises:
        NoSceneError: when none is found.
    """
    for _ in range(DRAWS):
        headings = random_headings(rng, arm, rng.uniform(2.0, 9.0))
        axis = shapely.LineString(arm.joint_positions(headings))
        if (room is None or room.contains(axis)) and clear(arm, workspace, headings):
            return headings
    raise NoSceneError("no start")


def smooth(corners: FloatArray, radius: float) -> FloatArray:
    """A polyline with its corners rounded by parabolas that begin at most ``radius`` from them, shape (k, 2) [m]."""
    points = [corners[0]]
    for before, corner, after in zip(corners[:-2], corners[1:-1], corners[2:], strict=True):
        legs = before - corner, after - corner
        reach = min(radius, *(0.5 * float(np.hypot(*leg)) for leg in legs))
        a, b = (corner + reach * leg / np.hypot(*leg) for leg in legs)
        t = np.linspace(0.0, 1.0, 9)[:, None]
        points.extend((1 - t) ** 2 * a + 2 * t * (1 - t) * corner + t**2 * b)
    return np.array([*points, corners[-1]])


def carved(block: shapely.Polygon, corners: FloatArray, width: float) -> tuple[Obstacle, ...]:
    """What is left of a block when a duct with square corners is cut along a line."""
    duct = shapely.LineString(corners).buffer(0.5 * width, cap_style="flat", join_style="mitre")
    rest = shapely.difference(block, duct)
    pieces = [piece for piece in shapely.get_parts(rest) if piece.area > 1e-4]
    return tuple(Obstacle(f"block {k + 1}", PlaneShape(piece)) for k, piece in enumerate(pieces))


def s_duct(rng: np.random.Generator) -> Layout:
    """A duct with two right angles, its mouth near the base."""
    width = rng.uniform(0.09, 0.2)
    rise = rng.choice((-1.0, 1.0)) * rng.uniform(0.2, 0.4)
    mouth = rng.uniform(0.12, 0.2)
    riser = rng.uniform(0.42, 0.55)
    y = rng.uniform(-0.03, 0.03)
    corners = np.array([[mouth - 0.01, y], [riser, y], [riser, y + rise], [1.3, y + rise]])
    block = shapely.box(mouth, -0.9, 1.2, 0.9)
    centre = smooth(np.vstack(([0.0, 0.0], corners[1:], [1.6, y + rise])), rng.uniform(0.4, 0.5) * width)
    return Layout(carved(block, corners, width), centre, shapely.box(-1.2, -1.2, mouth, 1.2))


def u_turn(rng: np.random.Generator) -> Layout:
    """Round the end of a tongue and back into the pocket behind it."""
    side = rng.choice((-1.0, 1.0))
    gap = rng.uniform(0.16, 0.34)
    end = rng.uniform(0.35, 0.5)
    thick = float(rng.choice((0.0, 0.03, 0.08)))
    low = rng.uniform(0.06, 0.12)
    high = low + thick + gap
    tongue = _box(0.15, side * low, end, side * (low + thick)) if thick else _sheet((0.15, end), side * low)
    walls = (
        Obstacle("tongue", PlaneShape(tongue)),
        Obstacle("back", PlaneShape(_box(0.1, side * low, 0.15, side * high))),
        Obstacle("lid", PlaneShape(_box(0.1, side * high, end + 0.4, side * (high + 0.1)))),
    )
    y = side * (low + thick + 0.5 * gap)
    corners = np.array([[0.0, 0.0], [end + 0.12, 0.0], [end + 0.12, y], [-0.5, y]])
    return Layout(walls, smooth(corners, 0.5 * abs(y)))


def slalom(rng: np.random.Generator) -> Layout:
    """Round posts on alternating sides of a line."""
    posts = int(rng.integers(2, 6))
    first = rng.uniform(0.14, 0.22)
    step = rng.uniform(0.16, 0.24)
    side = rng.choice((-1.0, 1.0))
    radius = rng.uniform(0.0, 0.05)
    swing = rng.uniform(0.04, 0.09)
    sides = side * (-1.0) ** np.arange(posts)
    x = first + step * np.arange(posts)
    obstacles = [
        Obstacle(f"post {k + 1}", PlaneShape(shapely.Point(a, b * (swing + radius) - b * 0.06), radius))
        if radius > 0.01
        else Obstacle(f"post {k + 1}", PlaneShape(shapely.LineString([(a, b * (swing - 0.06)), (a, b * 0.4)])))
        for k, (a, b) in enumerate(zip(x, sides, strict=True))
    ]
    line = np.linspace(0.0, 1.6, 161)
    wave = np.interp(line, [0.0, *x, x[-1] + step, 2.0], [0.0, *(-0.06 * sides), 0.0, 0.0])
    kernel = np.hanning(13) / np.hanning(13).sum()
    wave = np.convolve(np.pad(wave, 6, mode="edge"), kernel, mode="valid")
    centre = np.stack((line, wave - wave[0]), axis=1)
    return Layout(tuple(obstacles), centre)


def gates(rng: np.random.Generator) -> Layout:
    """Sheets across the way, each with a gap at another height."""
    count = int(rng.integers(1, 4))
    x = rng.uniform(0.2, 0.35) + rng.uniform(0.2, 0.28) * np.arange(count)
    y = rng.uniform(-0.12, 0.12, count)
    width = rng.uniform(0.07, 0.16)
    thick = float(rng.choice((0.0, 0.01)))
    obstacles = [
        Obstacle(
            f"gate {k + 1}, {name}", PlaneShape(shapely.LineString([(a, b + s * 0.5 * width), (a, s * 1.0)]), thick)
        )
        for k, (a, b) in enumerate(zip(x, y, strict=True))
        for name, s in (("top", 1.0), ("bottom", -1.0))
    ]
    line = np.linspace(0.0, 1.6, 161)
    wave = np.interp(line, [0.0, *np.column_stack((x - 0.03, x + 0.03)).ravel(), 2.0], [0.0, *np.repeat(y, 2), y[-1]])
    kernel = np.hanning(15) / np.hanning(15).sum()
    wave = np.convolve(np.pad(wave, 7, mode="edge"), kernel, mode="valid")
    return Layout(tuple(obstacles), np.stack((line, wave - wave[0]), axis=1))


def _sheet(ends: tuple[float, float], y: float) -> shapely.LineString:
    return shapely.LineString([(ends[0], y), (ends[1], y)])


def _box(x0: float, y0: float, x1: float, y1: float) -> shapely.Polygon:
    return shapely.box(x0, min(y0, y1), x1, max(y0, y1))


LAYOUTS: dict[str, tuple[Callable[[np.random.Generator], Layout], float]] = {
    "s-duct": (s_duct, 0.025),
    "u-turn": (u_turn, 0.03),
    "slalom": (slalom, 0.02),
    "gates": (gates, 0.02),
}
"""Layouts with the widest radius of their arms [m]."""
UNFOLDING = "unfolding"
FAMILIES = (*LAYOUTS, UNFOLDING)


def unfolding(rng: np.random.Generator, links: int) -> Scene:
    """Polygons strewn where a known motion, straight in the joints, does not come: a solution exists.

    Raises:
        NoSceneError: when no such motion is free of the arm itself.
    """
    arm = random_arm(rng, links, 0.05)
    empty = Workspace(ROOM)
    for _ in range(DRAWS):
        start = random_headings(rng, arm, 4.0)
        goal = start + random_headings(rng, arm, 4.0) - arm.base_heading
        if all(_free(arm, swept(start, goal, steps)) for steps in (3, 12, POSES)):
            break
    else:
        raise NoSceneError("no motion")
    trace = shapely.multilinestrings(shapely.linestrings(arm.joint_positions(swept(start, goal, 4 * POSES))))
    shapely.prepare(trace)
    obstacles = []
    for k in range(int(rng.choice((10, 30, 60)))):
        polygon = random_polygon(rng, rng.uniform(-1.1, 1.1, 2))
        if not shapely.dwithin(trace, polygon, arm.radius + 2.0 * SPARE):
            obstacles.append(Obstacle(f"polygon {k + 1}", PlaneShape(polygon)))
    return Scene(arm, replace(empty, obstacles=tuple(obstacles)), start, goal)


def _free(arm: Arm, way: FloatArray) -> bool:
    """Whether poses keep the room and themselves."""
    if np.any(np.abs(arm.bends(way))[:, 1:] > 0.97 * arm.joint_limit):
        return False
    points = arm.joint_positions(way)
    if float(wall_gaps(arm, Workspace(ROOM), points).min()) < SPARE:
        return False
    return all(self_gap(arm, pose) > SPARE for pose in points)


def passage(name: str, rng: np.random.Generator, links: int) -> Scene:
    """A scene of one of the layouts.

    Raises:
        NoSceneError: when the arm cannot lie in it, or no start is found.
    """
    make, widest = LAYOUTS[name]
    for _ in range(30):
        layout = make(rng)
        arm = random_arm(rng, links, widest)
        workspace = Workspace(ROOM, layout.obstacles)
        goal = laid_on(arm, layout.centre)
        if clear(arm, workspace, goal):
            return Scene(arm, workspace, drawn_start(rng, arm, workspace, layout.room), goal)
    raise NoSceneError("the arm cannot lie in the passage")


def scene(family: str, seed: int, links: int) -> Scene:
    """One scene.

    Raises:
        NoSceneError: when none comes of the seed.
    """
    rng = np.random.default_rng([seed, links, FAMILIES.index(family)])
    return unfolding(rng, links) if family == UNFOLDING else passage(family, rng, links)


def problem(family: str, seed: int, links: int, time_limit: float = 60.0) -> Problem:
    """A scene with one of three kinds of goals at its goal pose.

    Raises:
        NoSceneError: when none comes of the seed.
    """
    drawn = scene(family, seed, links)
    kind = np.random.default_rng([seed, links, FAMILIES.index(family), 1]).random()
    goal: TipGoal | JointPose = drawn.goal_tip
    if kind < WHOLE_ARM:
        goal = JointPose(drawn.arm.bends(drawn.goal))
    elif kind < WHOLE_ARM + POSITION_ONLY:
        goal = TipGoal(drawn.goal_tip.position)
    named = drawn.problem(goal, time_limit)
    return replace(named, name=f"{family}-{links}-{seed}")


def problems(
    families: tuple[str, ...], seeds: range, links: tuple[int, ...] = LINKS, time_limit: float = 60.0
) -> Iterator[tuple[str, Problem]]:
    """Problems with their families; seeds without a scene are left out."""
    for seed in seeds:
        for family in families:
            for count in links:
                try:
                    yield family, problem(family, seed, count, time_limit)
                except NoSceneError:
                    continue
