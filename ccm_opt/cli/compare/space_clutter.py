"""Random problems in space: clutter, and shipped jobs with perturbed ends; and the arms for both.

The arm in clutter has a length of 1 m and a radius of 15 mm, with its base at the origin; the clutter consists of
balls, boxes at any orientation, and bars with flat or round ends, all within reach of the arm. A seed gives the same
scene on every machine.
"""

from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import ProblemError
from ccm_opt.io.reading import load_problem
from ccm_opt.problem import JointPose, Problem, TipGoal
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.coordinates import Limits
from ccm_opt.robot.link_bodies import cylinder_inertia
from ccm_opt.scene.bodies import Body, BoxBody, CapsuleBody, CylinderBody, RigidPlacement, SphereBody
from ccm_opt.scene.distances.enclosures import segment_distances
from ccm_opt.scene.distances.surface_tree import SurfaceTree
from ccm_opt.scene.surfaces import TriangleSoup
from ccm_opt.scene.workspace import Obstacle, Workspace

USUAL_LINKS = 24
"""Number of links of the shipped problems."""
MASS = 0.5
"""Mass of a whole arm [kg]."""
JOINT_LIMIT = float(np.deg2rad(45.0))
"""Limit of each bend for arms with the usual number of links or more [rad]."""
LENGTH = 1.0
"""Length of the arm [m]."""
RADIUS = 0.015
"""Radius of its links [m]."""
KEPT_OFF = 0.01
"""Least gap of the start and goal poses to bodies and between links [m]."""
BEND = 3.0
"""Standard deviation of the curvature of random poses, in each direction [1/m]."""
VELOCITY = 1.0
"""Velocity limit of every revolute [rad/s]."""
ACCELERATION = 2.0
"""Acceleration limit of every revolute [rad/s²]."""


def arm_of_links(links: int, length: float, radius: float) -> Arm:
    """Return an arm at the origin along x, whose base may bend in any direction."""
    coarse = Arm(
        links=2,
        link_length=0.5 * length,
        radius=radius,
        base=np.zeros(3),
        direction=np.array([1.0, 0.0, 0.0]),
        joint_limit=JOINT_LIMIT,
        base_limit=2.0 * np.pi,
        self_collision=True,
        mount_length=radius,
        masses=np.full(2, 0.5 * MASS),
        inertia_axial=np.zeros(2),
        inertia_transverse=np.zeros(2),
    )
    return with_links(coarse, links)


def with_links(arm: Arm, links: int) -> Arm:
    """Return an arm with another number of links, all with equal drives, but the same length, radius and mass.

    With fewer links, joints may bend more, up to a right angle, as the same curve requires.
    """
    masses = np.full(links, float(np.sum(arm.masses)) / links)
    axial, transverse = cylinder_inertia(masses, arm.radius, arm.length / links)
    return replace(
        arm,
        links=links,
        link_length=arm.length / links,
        joint_limit=min(max(JOINT_LIMIT, JOINT_LIMIT * USUAL_LINKS / links), 0.5 * np.pi),
        masses=masses,
        inertia_axial=axial,
        inertia_transverse=transverse,
        rotor_inertia=float(np.mean(arm.rotor_inertia)),
        friction=float(np.mean(arm.friction)),
    )


def random_bends(rng: np.random.Generator, arm: Arm, bend: float = BEND) -> FloatArray:
    """Sample the bends of a smooth random pose, shape (c,) [rad].

    The curvature has the standard deviation ``bend`` [1/m] in each direction.
    """
    middles = (np.arange(arm.links) + 0.5) / arm.links
    # Six normally distributed curvatures in each direction, interpolated linearly: smooth but arbitrary.
    knots = rng.normal(0.0, bend, (arm.dimension - 1, 6))
    bends = np.column_stack([np.interp(middles, np.linspace(0.0, 1.0, 6), row) * arm.link_length for row in knots])
    bends[0, 0] = rng.uniform(-np.pi, np.pi)  # the base may point anywhere
    if arm.dimension == 3:
        bends[0, 1] = np.arcsin(rng.uniform(-1.0, 1.0))
    # A little inside the limits, so that no problem fails because of rounding at its start or goal.
    return np.asarray(np.clip(bends.ravel(), -0.95 * arm.bend_limits, 0.95 * arm.bend_limits))


def clear_bends(rng: np.random.Generator, arm: Arm, bend: float = BEND) -> FloatArray:
    """Sample the bends of a smooth random pose without self-contact, shape (c,) [rad]."""
    while True:
        q = random_bends(rng, arm, bend)
        if links_apart(arm, arm.joint_positions_at(q), KEPT_OFF):
            return q


def links_apart(arm: Arm, points: FloatArray, gap: float) -> bool:
    """Return whether non-adjacent links are farther apart than a gap [m], for points of shape (links + 1, d) [m]."""
    i, j = arm.distant_pairs
    apart = segment_distances(points[i], points[i + 1], points[j], points[j + 1])[2]
    return bool(np.all(apart > 2.0 * arm.radius + gap))


def axes_of(points: FloatArray) -> FloatArray:
    """Return the axes of links as segments, shape (links, 2, 3) [m]."""
    return np.stack((points[:-1], points[1:]), axis=1)


def space_clutter(seed: int, count: int, links: int, name: str) -> Problem:
    """Return a random problem among clutter in space.

    Start and goal pose are sampled first, then bodies within the arm's reach that touch neither pose.

    Args:
        seed: seed of the scene.
        count: number of bodies.
        links: number of links of the arm.
        name: name of the problem.

    Returns:
        The problem: from the start pose to the position and direction of the tip in the goal pose.
    """
    rng = np.random.default_rng(seed)
    arm = arm_of_links(links, LENGTH, RADIUS)
    start, goal = (clear_bends(rng, arm) for _ in range(2))
    axes = np.concatenate([axes_of(arm.joint_positions_at(pose)) for pose in (start, goal)])
    bodies: list[Obstacle] = []
    while len(bodies) < count:
        body = _random_body(rng, LENGTH * _in_ball(rng))
        tree = SurfaceTree.of(TriangleSoup.joined([("", body.triangles, body.rounding)]))
        if float(tree.distances(axes, 4.0 * RADIUS).min()) > arm.radius + KEPT_OFF:
            bodies.append(Obstacle(f"body {len(bodies)}", body))
    bounds = 1.3 * LENGTH * np.array([[-1.0] * 3, [1.0] * 3])
    return Problem(
        name,
        Workspace(bounds=bounds, obstacles=tuple(bodies)),
        arm,
        Limits(np.full(3 * links, VELOCITY), np.full(3 * links, ACCELERATION)),
        JointPose(start.reshape(links, 2)),
        TipGoal(arm.joint_positions_at(goal)[-1], arm.link_rotations(goal)[-1, :, 0]),
    )


def _random_body(rng: np.random.Generator, middle: FloatArray) -> Body:
    """Sample a ball, a box or a bar of random size at a given position.

    Balls and boxes are 60 to 180 mm thick; bars are 20 to 60 mm thick and 0.1 to 0.4 m long.
    """
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


JOBS: Mapping[str, Mapping[str, float]] = {
    "elbow": {"base": 0.01, "fed": 0.1, "goal": 0.03, "turn": 0.25, "room": 0.004},
    "wing-box": {"base": 0.02, "fed": 0.05, "goal": 0.02, "turn": 0.25, "room": 0.004},
    "blade-row": {"base": 0.003, "fed": 0.1, "goal": 0.01, "turn": 0.15, "room": 0.002},
}
"""Greatest perturbations of the ends of shipped problems, by name: the base across its direction [m], the feed at the
start [m], the goal [m] and its direction [rad]; and the least gap of the straight arm at the start and of the last link
at the goal [m]. Taste, all of them: fractions of the clearance that there is."""
MOST_DRAWS = 1000
"""Most samples of the ends; if all touch something, the perturbation is too large for the scene."""


def disturbed_job(seed: int, job: str, links: int, folder: Path, name: str) -> Problem:
    """Return a shipped problem with base, start and goal perturbed at random so that both ends are clear.

    Args:
        seed: seed of the perturbation.
        job: name of the shipped problem.
        links: number of links of the arm.
        folder: folder of the shipped problems in space.
        name: name of the new problem.

    Raises:
        ProblemError: no clear ends were sampled.
    """
    problem, tree = _shipped(folder / f"{job}.toml")
    goal, whole = problem.goal, problem.arm
    if goal.direction is None:
        raise ProblemError(f"the goal of {job} is not a tip position with a direction")
    moved = JOBS[job]
    kept = whole.radius + problem.workspace.clearance + moved["room"]
    rng = np.random.default_rng(seed)
    for _ in range(MOST_DRAWS):
        across = _in_ball(rng)
        base = whole.base + moved["base"] * (across - (across @ whole.direction) * whole.direction)
        arm = with_links(replace(whole, base=base), links)
        start = JointPose(np.zeros((links, 2)), arm.base_range[0] + float(rng.uniform(0.0, moved["fed"])))
        place = goal.tip(whole) + moved["goal"] * _in_ball(rng)
        direction = goal.direction + np.tan(moved["turn"]) * _in_ball(rng)
        direction /= np.linalg.norm(direction)
        # The usual link length whatever the number of links, so that a seed gives the same ends for all of them.
        last = np.stack((place - whole.link_length * direction, place))
        points = arm.joint_positions_at(start.configuration(arm))
        # The mount of the straight arm may touch obstacles.
        straight = np.stack((points[0] + (arm.mount_length + arm.radius) * arm.direction, points[-1]))
        if float(tree.distances(np.stack((last, straight)), kept).min()) >= kept:
            tip = TipGoal(place, direction, goal.via)
            limits = _limits(problem.limits, links)
            return replace(problem, name=name, arm=arm, start=start, goal=tip, limits=limits, source="")
    raise ProblemError(f"no start and goal near those of {job} keep a gap of {moved['room']} m")


@cache
def _shipped(file: Path) -> tuple[Problem, SurfaceTree]:
    problem = load_problem(file)
    return problem, SurfaceTree.of(problem.workspace.soup)


def _limits(limits: Limits, links: int) -> Limits:
    """Return limits for another number of links; those of the shipped problems are equal for all revolutes."""
    given = {key: getattr(limits, key) for key in ("velocity", "acceleration", "torque", "jerk")}
    whole = {key: np.full(3 * links, float(values[0])) for key, values in given.items() if values is not None}
    return replace(limits, **whole)  # type: ignore[arg-type]


def _in_ball(rng: np.random.Generator) -> FloatArray:
    """Sample a point uniformly in the unit ball, shape (3,)."""
    way = rng.normal(size=3)
    return np.asarray(rng.uniform() ** (1.0 / 3.0) * way / np.linalg.norm(way))
