"""Random clutter in space, and routes through it.

The arm reaches 1 m with a radius of 15 mm, its base at the origin; the clutter is balls, boxes turned any way, and bars
with flat and with round ends, all in reach of the arm. A seed gives the same scene on every machine.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cache, cached_property
from pathlib import Path

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import ProblemError
from ccm_opt.io.reading import load_problem
from ccm_opt.problem import JointPose, Problem, TipGoal
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.coordinates import Limits
from ccm_opt.robot.inverse_kinematics import configuration_from_positions
from ccm_opt.robot.link_bodies import cylinder_inertia
from ccm_opt.scene.bodies import Body, BoxBody, CapsuleBody, CylinderBody, RigidPlacement, SphereBody
from ccm_opt.scene.distances.enclosures import segment_distances
from ccm_opt.scene.distances.surface_tree import SurfaceTree
from ccm_opt.scene.surfaces import SurfaceSoup
from ccm_opt.scene.workspace import Obstacle, Workspace

STEP = 0.004
"""Between the places of a route [m]."""


@dataclass(frozen=True, eq=False)
class Route:
    """Places on a way, even to a few millimetres; it runs on straight before and beyond.

    Attributes:
        places: shape (m, 3) [m].
    """

    places: FloatArray

    @classmethod
    def round_corners(cls, corners: FloatArray, radius: float) -> "Route | None":
        """Straight from corner to corner, with arcs of a radius in between; None where the corners are too near."""
        parts = [corners[0]]
        places: list[FloatArray] = []
        for before, corner, after in zip(corners[:-2], corners[1:-1], corners[2:], strict=True):
            inwards = (corner - before) / np.linalg.norm(corner - before)
            outwards = (after - corner) / np.linalg.norm(after - corner)
            turn = float(np.arccos(np.clip(inwards @ outwards, -1.0, 1.0)))
            if turn < 1e-3:
                continue
            cut = radius * np.tan(0.5 * turn)
            first = corner - cut * inwards
            if (first - parts[-1]) @ inwards < 0.0 or cut > float(np.linalg.norm(after - corner)):
                return None
            places.extend(_straight(parts[-1], first))
            places.extend(_arc(first, inwards, outwards, radius, turn))
            parts.append(corner + cut * outwards)
        places.extend(_straight(parts[-1], corners[-1]))
        places.append(corners[-1])
        return cls(np.stack(places))

    @cached_property
    def arcs(self) -> FloatArray:
        """Arc lengths of the places, shape (m,) [m]."""
        return np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(self.places, axis=0), axis=1))))

    @property
    def length(self) -> float:
        """From its beginning to its end [m]."""
        return float(self.arcs[-1])

    def at(self, s: FloatArray) -> FloatArray:
        """Places at arc lengths, shape (..., 3) [m]."""
        places = np.stack([np.interp(s, self.arcs, column) for column in self.places.T], axis=-1)
        before = np.minimum(s, 0.0)[..., None] * self.direction_at_start
        beyond = np.maximum(s - self.length, 0.0)[..., None] * self.direction_at_end
        return np.asarray(places + before + beyond)

    @property
    def direction_at_start(self) -> FloatArray:
        """Unit vector, shape (3,)."""
        first = self.places[1] - self.places[0]
        return np.asarray(first / np.linalg.norm(first))

    @property
    def direction_at_end(self) -> FloatArray:
        """Unit vector, shape (3,)."""
        last = self.places[-1] - self.places[-2]
        return np.asarray(last / np.linalg.norm(last))

    def part(self, low: float, high: float) -> FloatArray:
        """Places between two arc lengths, shape (k, 3) [m]."""
        count = max(2, int(np.ceil((high - low) / STEP)) + 1)
        return self.at(np.linspace(low, high, count))


def laid_along(arm: Arm, route: Route, end: float) -> FloatArray | None:
    """The configuration with all joints on a route and the tip near an arc length of it; None where it breaks limits.

    Args:
        arm: an arm, the line of whose base is that along which the route begins.
        route: from the end of the arm's guide tube, or from its fixed base.
        end: where the tip is [m].
    """
    base = 0.0
    if arm.base_axes:
        # The base stands where the rest of the arm reaches the end; chords are a little shorter than arcs.
        tube = float((route.places[0] - arm.base) @ arm.direction)
        base = end - arm.length
        for _ in range(8):
            reached = _chorded(route, base, arm)[1]
            base += end - reached
        if base > 0.0:
            return None
        low, high = arm.base_range
        if not low <= tube + base <= high:
            return None
    points, _ = _chorded(route, base, arm)
    if np.linalg.norm(np.cross(points[0] - arm.base, arm.direction)) > 1e-9:
        return None
    q = configuration_from_positions(arm, points)
    held = arm.held_bends(float(np.sum(q[2 * arm.links :])))
    if np.max(np.abs(q[: 2 * arm.links][held]), initial=0.0) > 1e-9:
        return None
    q[: 2 * arm.links][held] = 0.0
    return q if np.all(np.abs(q[: 2 * arm.links]) <= 0.97 * arm.bend_limits) else None


def _chorded(route: Route, start: float, arm: Arm) -> tuple[FloatArray, float]:
    """Joints and tip a link apart along a route from an arc length on, and the arc length of the tip."""
    points = [route.at(np.array(start))]
    s = start
    for _ in range(arm.links):
        low = s
        high = s + 2.0 * arm.link_length
        for _ in range(60):
            middle = 0.5 * (low + high)
            if float(np.linalg.norm(route.at(np.array(middle)) - points[-1])) < arm.link_length:
                low = middle
            else:
                high = middle
        s = 0.5 * (low + high)
        step = route.at(np.array(s)) - points[-1]
        points.append(points[-1] + arm.link_length * step / np.linalg.norm(step))
    return np.stack(points), s


def _straight(start: FloatArray, end: FloatArray) -> list[FloatArray]:
    count = max(1, int(np.linalg.norm(end - start) / STEP))
    return [start + (end - start) * k / count for k in range(count)]


def _arc(first: FloatArray, inwards: FloatArray, outwards: FloatArray, radius: float, turn: float) -> list[FloatArray]:
    across = outwards - (outwards @ inwards) * inwards
    across /= np.linalg.norm(across)
    count = max(2, int(radius * turn / STEP))
    angles = turn * np.arange(count) / count
    return [first + radius * (np.sin(a) * inwards + (1.0 - np.cos(a)) * across) for a in angles]


@dataclass(frozen=True, eq=False)
class Site:
    """Bodies and the ways among them; a fed arm's guide tube ends at the origin, a fixed arm's base is there.

    Both point along x.

    Attributes:
        bodies: with their names.
        routes: on which the arm lies at the goal, up to an arc length; where there are two, at the start on the first.
        fed: whether the arm has a feed axis.
        directed: whether the goal asks for a direction.
        whole_pose: whether the goal is a pose of all joints.
        via: places that the tip has to pass, each of shape (3,) [m].
        radius: of the arm [m].
    """

    bodies: list[tuple[str, Body]]
    routes: tuple[tuple[Route, float], ...]
    fed: bool = True
    directed: bool = True
    whole_pose: bool = False
    via: tuple[FloatArray, ...] = field(default=())
    radius: float = 0.012


USUAL_LINKS = 24
"""Of the shipped problems."""
MASS = 0.5
"""Of a whole arm [kg]."""
JOINT_LIMIT = float(np.deg2rad(45.0))
"""Of each bend where there are as many links as usual, or more [rad]."""


def arm_of_links(links: int, length: float, radius: float) -> Arm:
    """An arm at the origin along x, whose base turns any way."""
    masses = np.full(links, MASS / links)
    axial, transverse = cylinder_inertia(masses, radius, length / links)
    return Arm(
        links=links,
        link_length=length / links,
        radius=radius,
        base=np.zeros(3),
        direction=np.array([1.0, 0.0, 0.0]),
        up=np.array([0.0, 0.0, 1.0]),
        joint_limit=joint_limit(links),
        base_limit=2.0 * np.pi,
        self_collision=True,
        mount_length=radius,
        masses=masses,
        inertia_axial=axial,
        inertia_transverse=transverse,
    )


def joint_limit(links: int) -> float:
    """Bound on a bend [rad]: few links have to bend more for the same curve, up to a right angle."""
    return min(max(JOINT_LIMIT, JOINT_LIMIT * USUAL_LINKS / links), 0.5 * np.pi)


def with_links(arm: Arm, links: int) -> Arm:
    """An arm as long, thick and heavy, of another number of links, whose drives are all alike."""
    masses = np.full(links, float(np.sum(arm.masses)) / links)
    axial, transverse = cylinder_inertia(masses, arm.radius, arm.length / links)
    return replace(
        arm,
        links=links,
        link_length=arm.length / links,
        joint_limit=joint_limit(links),
        masses=masses,
        inertia_axial=axial,
        inertia_transverse=transverse,
        rotor_inertia=float(np.mean(arm.rotor_inertia)),
        friction=float(np.mean(arm.friction)),
    )


LENGTH = 1.0
"""Length of the arm [m]."""
RADIUS = 0.015
"""Radius of its links [m]."""
KEPT_OFF = 0.01
"""Least gap between the start or goal pose and a body, or another link [m]."""
BEND = 3.0
"""Standard deviation of the curvature of random poses, in each direction [1/m]."""
VELOCITY = 1.0
"""Limit of every revolute [rad/s]."""
ACCELERATION = 2.0
"""Limit of every revolute [rad/s²]."""


def space_clutter(seed: int, count: int, links: int, name: str) -> Problem:
    """Start and goal pose drawn first, then bodies within the arm's reach that keep off both.

    Args:
        seed: of the scene.
        count: of bodies.
        links: of the arm.
        name: of the problem.

    Returns:
        The problem: from the start pose to the place and direction of the tip in the goal pose.
    """
    rng = np.random.default_rng(seed)
    arm = arm_of_links(links, LENGTH, RADIUS)
    start = _clear_pose(rng, arm)
    goal = _clear_pose(rng, arm)
    axes = np.concatenate([_axes(arm.joint_positions_at(pose)) for pose in (start, goal)])
    bodies: list[Obstacle] = []
    while len(bodies) < count:
        body = _random_body(rng, LENGTH * _in_ball(rng))
        if _apart(body, axes) > arm.radius + KEPT_OFF:
            bodies.append(Obstacle(f"body {len(bodies)}", body))
    wide = 1.3 * LENGTH
    bounds = np.array([[-wide, -wide, -wide], [wide, wide, wide]])
    tip = TipGoal(arm.joint_positions_at(goal)[-1], arm.link_rotations(goal)[-1, :, 0])
    revolutes = 3 * links
    return Problem(
        name,
        Workspace(bounds=bounds, obstacles=tuple(bodies)),
        arm,
        Limits(np.full(revolutes, VELOCITY), np.full(revolutes, ACCELERATION)),
        JointPose(start.reshape(links, 2)),
        tip,
    )


def _clear_pose(rng: np.random.Generator, arm: Arm) -> FloatArray:
    """Bends of a smooth random pose none of whose links comes near another, shape (2 links,) [rad]."""
    middles = (np.arange(arm.links) + 0.5) / arm.links
    while True:
        # Six normally distributed curvatures each way, linear between them: smooth but arbitrary.
        knots = rng.normal(0.0, BEND, (2, 6))
        bends = [np.interp(middles, np.linspace(0.0, 1.0, 6), row) * arm.link_length for row in knots]
        q = np.column_stack(bends).ravel()
        q[0] = rng.uniform(-np.pi, np.pi)  # the base may point anywhere
        q[1] = np.arcsin(rng.uniform(-1.0, 1.0))
        # A little inside the limits, so that no problem fails for rounding at its start or goal.
        q = np.asarray(np.clip(q, -0.95 * arm.bend_limits, 0.95 * arm.bend_limits))
        points = arm.joint_positions_at(q)
        i, j = arm.distant_pairs
        apart = segment_distances(points[i], points[i + 1], points[j], points[j + 1])[2]
        if np.all(apart > 2.0 * arm.radius + KEPT_OFF):
            return q


def _axes(points: FloatArray) -> FloatArray:
    """Axes of links, shape (links, 2, 3) [m]."""
    return np.stack((points[:-1], points[1:]), axis=1)


def _random_body(rng: np.random.Generator, middle: FloatArray) -> Body:
    """A ball, a box or a bar about a place: 60 to 180 mm thick, bars 20 to 60 mm thick and 0.1 to 0.4 m long."""
    kind = int(rng.integers(4))
    if kind == 0:
        return SphereBody(middle, float(rng.uniform(0.03, 0.09)))
    if kind == 1:
        half = rng.uniform(0.03, 0.09, 3)
        return BoxBody(-half, half, RigidPlacement.of_quaternion(middle, rng.normal(size=4)))
    way = rng.normal(size=3)
    half_way = 0.5 * rng.uniform(0.1, 0.4) * way / np.linalg.norm(way)
    bar = CylinderBody if kind == 2 else CapsuleBody
    return bar(middle - half_way, middle + half_way, float(rng.uniform(0.01, 0.03)))


def _apart(body: Body, axes: FloatArray) -> float:
    """Least distance of a body from segments, shape (k, 2, 3), or somewhat beyond what matters [m]."""
    tree = SurfaceTree.of(SurfaceSoup.joined([("", body.triangles, body.rounding)]))
    return float(tree.distances(axes, 4.0 * RADIUS).min())


@dataclass(frozen=True)
class Disturbance:
    """How far the ends of a shipped problem are moved; all of it is taste, some of the room that there is.

    Attributes:
        base: shift of the base across its direction, at most [m].
        fed: how far the arm is fed in at the start, at most [m].
        goal: shift of the goal, at most [m].
        turn: of the goal's direction, at most [rad].
        room: gap that the straight arm at the start and the last link at the goal keep at least [m].
    """

    base: float
    fed: float
    goal: float
    turn: float
    room: float


JOBS: Mapping[str, Disturbance] = {
    "elbow": Disturbance(base=0.01, fed=0.1, goal=0.03, turn=0.25, room=0.004),
    "wing-box": Disturbance(base=0.02, fed=0.05, goal=0.02, turn=0.25, room=0.004),
    "blade-row": Disturbance(base=0.003, fed=0.1, goal=0.01, turn=0.15, room=0.002),
}
"""By the name of the shipped problem."""
MOST_DRAWS = 1000
"""After so many ends that touch something the disturbance is too large for the scene."""


def disturbed_job(seed: int, job: str, links: int, folder: Path, name: str) -> Problem:
    """A shipped problem whose base, start and goal are moved at random; ends that leave no room are drawn again.

    Args:
        seed: of the draws.
        job: name of the shipped problem.
        links: of the arm.
        folder: of the shipped problems in space.
        name: of the problem.

    Raises:
        ProblemError: no ends with room were drawn.
    """
    problem, tree = _shipped(folder / f"{job}.toml")
    goal = problem.goal
    if not isinstance(goal, TipGoal) or goal.direction is None:
        raise ProblemError(f"the goal of {job} is no place and direction of the tip")
    moved = JOBS[job]
    rng = np.random.default_rng(seed)
    whole = problem.arm
    for _ in range(MOST_DRAWS):
        base = whole.base + moved.base * _across(rng, whole.direction)
        arm = with_links(replace(whole, base=base), links)
        start = JointPose(np.zeros((links, 2)), arm.base_range[0] + float(rng.uniform(0.0, moved.fed)))
        place = goal.position + moved.goal * _in_ball(rng)
        direction = goal.direction + np.tan(moved.turn) * _in_ball(rng)
        direction /= np.linalg.norm(direction)
        # Of the usual length whatever the number of links, so that a seed has the same ends for all.
        last = np.stack((place - whole.link_length * direction, place))[None]
        kept = arm.radius + problem.workspace.clearance + moved.room
        if float(tree.distances(last, kept).min()) >= kept and _stands_free(tree, arm, start, kept):
            tip = replace(goal, position=place, direction=direction)
            limits = _limits(problem.limits, links)
            return replace(problem, name=name, arm=arm, start=start, goal=tip, limits=limits, source="")
    raise ProblemError(f"no start and goal near those of {job} leave {moved.room} m of room")


@cache
def _shipped(file: Path) -> tuple[Problem, SurfaceTree]:
    problem = load_problem(file)
    if problem.dimension == 2:
        raise ProblemError(f"{file} is no problem in space")
    return problem, SurfaceTree.of(problem.workspace.soup)


def _stands_free(tree: SurfaceTree, arm: Arm, start: JointPose, kept: float) -> bool:
    """Whether the arm beyond its mount keeps a distance at the start."""
    points = arm.joint_positions_at(start.configuration(arm))
    along = points[0] + (arm.mount_length + arm.radius) * arm.direction
    return float(tree.distances(np.stack((along, points[-1]))[None], kept).min()) >= kept


def _limits(limits: Limits, links: int) -> Limits:
    """The limits of an arm of another number of links; those of the shipped problems are alike for all."""

    def all_alike(values: FloatArray) -> FloatArray:
        return np.full(3 * links, float(values[0]))

    torque = None if limits.torque is None else all_alike(limits.torque)
    jerk = None if limits.jerk is None else all_alike(limits.jerk)
    velocity = all_alike(limits.velocity)
    return replace(limits, velocity=velocity, acceleration=all_alike(limits.acceleration), torque=torque, jerk=jerk)


def _in_ball(rng: np.random.Generator) -> FloatArray:
    """A place in the unit ball, all alike likely, shape (3,)."""
    way = rng.normal(size=3)
    return np.asarray(rng.uniform() ** (1.0 / 3.0) * way / np.linalg.norm(way))


def _across(rng: np.random.Generator, direction: FloatArray) -> FloatArray:
    """A place in the unit disc across a direction, shape (3,)."""
    place = _in_ball(rng)
    return np.asarray(place - (place @ direction) * direction)
