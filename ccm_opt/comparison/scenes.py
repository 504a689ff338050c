"""Seeded random scenes for comparisons: an arm among walls, with a start and a goal pose that touch nothing.

The arm reaches 1 m with a radius of 15 mm; clutter is polygons of 3–8 vertices, 30–90 mm from their middle. A seed
gives the same scene on every machine.
"""

from dataclasses import dataclass, replace

import numpy as np
import shapely
from scipy.optimize import brentq

from ccm_opt.freespace.obstacle import Obstacle
from ccm_opt.freespace.workspace import Workspace
from ccm_opt.ground.angles import unit_vector
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.jointed.arm import Arm
from ccm_opt.problem import JointPose, Limits, PlannerOptions, Problem, TipGoal

LENGTH = 1.0
"""Length of the arm [m]."""
RADIUS = 0.015
"""Radius of its links [m]."""
KEPT_OFF = 0.01
"""Least gap between the start or goal pose and an obstacle that is placed beside it, or another link [m]."""
ROOM = shapely.box(-1.3, -1.3, 1.3, 1.3)
"""Boundary of every scene, out of the arm's reach [m]."""
VELOCITY = 1.0
"""Limit of every revolute [rad/s]."""
ACCELERATION = 2.0
"""Limit of every revolute [rad/s²]."""


@dataclass(frozen=True)
class Scene:
    """An arm among walls with two poses that touch nothing.

    Attributes:
        arm: the arm.
        workspace: its room.
        start: link headings, shape (links,) [rad].
        goal: link headings, shape (links,) [rad].
    """

    arm: Arm
    workspace: Workspace
    start: FloatArray
    goal: FloatArray

    @property
    def goal_tip(self) -> TipGoal:
        """Position and heading of the tip in the goal pose."""
        return TipGoal(self.arm.joint_positions(self.goal)[-1], float(self.goal[-1]))

    def problem(
        self, goal: TipGoal | JointPose | None = None, time_limit: float = 60.0, name: str = "scene"
    ) -> Problem:
        """The scene as a problem.

        Args:
            goal: of the motion; the tip of the goal pose when None.
            time_limit: of the planner [s].
            name: of the problem.
        """
        count = 3 * self.arm.links
        return Problem(
            name,
            self.workspace,
            self.arm,
            Limits(np.full(count, VELOCITY), np.full(count, ACCELERATION)),
            JointPose(self.arm.bends(self.start)),
            goal or self.goal_tip,
            planner=PlannerOptions(time_limit=time_limit),
        )


def make_arm(links: int = 24, radius: float = RADIUS, **changes: object) -> Arm:
    """An arm of length 1 m and 0.5 kg with its base at the origin, heading along x."""
    arm = Arm(
        links=links,
        link_length=LENGTH / links,
        radius=radius,
        base=np.zeros(2),
        base_heading=0.0,
        joint_limit=float(np.deg2rad(60.0)),
        base_limit=2.0 * np.pi,
        self_collision=True,
        mount_length=radius,
        masses=np.full(links, 0.5 / links),
        inertia_axial=np.full(links, 1e-5),
        inertia_transverse=np.full(links, 2e-5),
    )
    return replace(arm, **changes)  # type: ignore[arg-type]


def random_headings(rng: np.random.Generator, arm: Arm, bend: float = 3.0) -> FloatArray:
    """Link headings of a smooth random pose, shape (links,) [rad]; curvature has standard deviation ``bend`` [1/m]."""
    # Six normally distributed curvatures along the arm, linear between them, give a pose that is smooth but arbitrary.
    knots = rng.normal(0.0, bend, 6)
    middles = (np.arange(arm.links) + 0.5) / arm.links
    bends = np.interp(middles, np.linspace(0.0, 1.0, 6), knots) * arm.link_length
    bends[0] = rng.uniform(-np.pi, np.pi)  # the base may point anywhere
    # A little inside the limits, so that no problem fails for rounding at its start or goal.
    return arm.headings(np.clip(bends, -0.95 * arm.bend_limits, 0.95 * arm.bend_limits))


def clear_headings(rng: np.random.Generator, arm: Arm, bend: float = 3.0) -> FloatArray:
    """The same, drawn again until no link comes near another."""
    while True:
        headings = random_headings(rng, arm, bend)
        if links_apart(arm, arm.joint_positions(headings)):
            return headings


def links_apart(arm: Arm, points: FloatArray) -> bool:
    """Whether distant links keep more than ``KEPT_OFF`` between their surfaces; points (links + 1, 2) [m]."""
    links = np.asarray(shapely.linestrings(np.stack((points[:-1], points[1:]), axis=1)))
    i, j = arm.distant_pairs
    gaps = shapely.distance(links[i], links[j]) - 2.0 * arm.radius
    return bool(np.all(gaps > KEPT_OFF))


def random_polygon(rng: np.random.Generator, middle: FloatArray) -> shapely.Polygon:
    """A polygon of 3–8 vertices, 30–90 mm from a point (2,)."""
    while True:
        corners = rng.integers(3, 9)
        # Taken in order round the middle, corners seldom make an outline that crosses itself.
        angles = np.sort(rng.uniform(0.0, 2.0 * np.pi, corners))
        radii = rng.uniform(0.03, 0.09, corners)
        polygon = shapely.Polygon(middle + radii[:, None] * unit_vector(angles))
        if polygon.is_valid and polygon.area > 1e-4:
            return polygon


def clutter(seed: int, count: int = 20, links: int = 24) -> Scene:
    """Start and goal drawn first, then ``count`` polygons within the arm's reach that keep off both."""
    rng = np.random.default_rng(seed)
    arm = make_arm(links)
    start = clear_headings(rng, arm)
    goal = clear_headings(rng, arm)
    poses = shapely.MultiLineString([arm.joint_positions(pose) for pose in (start, goal)])
    obstacles: list[Obstacle] = []
    while len(obstacles) < count:
        polygon = random_polygon(rng, rng.uniform(-LENGTH, LENGTH, 2))
        if polygon.distance(poses) > arm.radius + KEPT_OFF:
            obstacles.append(Obstacle(f"polygon {len(obstacles)}", polygon))
    return Scene(arm, Workspace(ROOM, tuple(obstacles)), start, goal)


def open_space(seed: int, links: int = 24) -> Scene:
    """No obstacles: from the straight arm to a random pose (the open-space problem of section 3)."""
    rng = np.random.default_rng(seed)
    arm = make_arm(links)
    return Scene(arm, Workspace(ROOM), np.zeros(links), clear_headings(rng, arm))


def corridor(seed: int, width: float = 0.1, links: int = 24) -> Scene:
    """A duct to the right of the base, at a random height; the arm lies outside and has to put its end into it."""
    rng = np.random.default_rng(seed)
    arm = make_arm(links)
    height = rng.uniform(-0.2, 0.2)
    mouth = rng.uniform(0.45, 0.55)
    obstacles = (
        Obstacle("duct, top", shapely.box(mouth, height + 0.5 * width, 1.1, height + 0.5 * width + 0.1)),
        Obstacle("duct, bottom", shapely.box(mouth, height - 0.5 * width - 0.1, 1.1, height - 0.5 * width)),
    )
    start = np.full(links, rng.choice((-1.0, 1.0)) * rng.uniform(1.3, 1.9))
    return Scene(arm, Workspace(ROOM, obstacles), start, _into_duct(arm, height))


def _into_duct(arm: Arm, height: float) -> FloatArray:
    """Link headings of a step aside from the base that ends level at a height, shape (links,) [rad]."""
    middles = (np.arange(arm.links) + 0.5) / arm.links
    hump = np.where(middles < 0.45, np.sin(np.pi * middles / 0.45), 0.0)
    # The height wanted lies between those of a full step down and of a full step up.
    scale = brentq(lambda x: arm.joint_positions(x * hump)[-1, 1] - height, -1.0, 1.0)
    pose: FloatArray = scale * hump
    return pose
