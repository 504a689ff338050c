"""Named suites of problems for comparisons: example problems, and random problems from seeds.

The arm of planar random problems has a length of 1 m and a radius of 15 mm; random obstacles (clutter) are polygons of
3–8 vertices, 30–90 mm from their centre. A seed gives the same scene on every machine.
"""

import hashlib
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from importlib import import_module
from pathlib import Path

import numpy as np
import shapely
from scipy.optimize import brentq

from ccm_opt.cli.compare.methods import code_of
from ccm_opt.cli.compare.space_clutter import (
    ACCELERATION,
    BEND,
    JOBS,
    KEPT_OFF,
    LENGTH,
    RADIUS,
    USUAL_LINKS,
    VELOCITY,
    clear_bends,
    disturbed_job,
    random_bends,
    space_clutter,
)
from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import ProblemError
from ccm_opt.core.files import strict_text
from ccm_opt.core.polyline import unit_vector
from ccm_opt.io.problem_data import problem_data
from ccm_opt.io.reading import load_problem
from ccm_opt.problem import JointPose, Limits, PlannerOptions, Problem, TipGoal
from ccm_opt.robot.arm import Arm
from ccm_opt.scene.workspace import Obstacle, PlaneShape, Workspace

SPACE = "space-"
"""Prefix of the names of suites in space."""
SPACE_SUITES = (
    *(f"{SPACE}clutter-{count}" for count in (20, 40, 80, 160, 320)),
    *(f"{SPACE}{job}" for job in JOBS),
)
"""Names of suites in space with the usual number of links; a suffix such as ``-8-links`` gives another even number."""
_NAME = re.compile(rf"{SPACE}(clutter-(?P<count>\d{{1,4}})|(?P<job>{'|'.join(JOBS)}))(-(?P<links>\d{{1,3}})-links)?")


ROOM = shapely.box(-1.3, -1.3, 1.3, 1.3)
"""Workspace boundary of every random planar scene, out of the arm's reach [m]."""


@dataclass(frozen=True)
class Scene:
    """A planar arm of n links among obstacles, with collision-free start and goal poses.

    Attributes:
        arm: the arm.
        workspace: boundary and obstacles.
        start: headings of the links in the start pose, shape (n,) [rad].
        goal: headings of the links in the goal pose, shape (n,) [rad].
    """

    arm: Arm
    workspace: Workspace
    start: FloatArray
    goal: FloatArray

    @property
    def goal_tip(self) -> TipGoal:
        """Goal with the tip's position and heading in the goal pose."""
        return TipGoal(self.arm.joint_positions(self.goal)[-1], heading=float(self.goal[-1]))

    def problem(
        self, goal: TipGoal | JointPose | None = None, time_limit: float = 60.0, name: str = "scene"
    ) -> Problem:
        """Return the problem of moving the arm of this scene from the start pose to a goal.

        Args:
            goal: goal of the motion; None for the tip position and heading of the goal pose.
            time_limit: CPU time limit of the planner [s].
            name: name of the problem.
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
    """Return a planar arm with a length of 1 m and a mass of 0.5 kg, its base at the origin, straight along x.

    Args:
        links: number of links.
        radius: radius of the arm [m].
        changes: other values of attributes of the arm, by name.
    """
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


def random_headings(rng: np.random.Generator, arm: Arm, bend: float = BEND) -> FloatArray:
    """Return the headings of the n links of a planar arm in a smooth random pose, shape (n,) [rad].

    Args:
        rng: random generator.
        arm: the arm.
        bend: standard deviation of the curvature [1/m].
    """
    return arm.headings(random_bends(rng, arm, bend))


def clear_headings(rng: np.random.Generator, arm: Arm, bend: float = BEND) -> FloatArray:
    """Return the headings of the n links of a planar arm in a random pose without self-collision, shape (n,) [rad].

    Arguments are those of ``random_headings``.
    """
    return arm.headings(clear_bends(rng, arm, bend))


def random_polygon(rng: np.random.Generator, middle: FloatArray) -> shapely.Polygon:
    """Return a random polygon with 3–8 vertices at distances of 30–90 mm from a point, shape (2,) [m]."""
    while True:
        corners = rng.integers(3, 9)
        # With corners in angular order, the outline seldom crosses itself.
        angles = np.sort(rng.uniform(0.0, 2.0 * np.pi, corners))
        radii = rng.uniform(0.03, 0.09, corners)
        polygon = shapely.Polygon(middle + radii[:, None] * unit_vector(angles))
        if polygon.is_valid and polygon.area > 1e-4:
            return polygon


def clutter(seed: int, count: int = 20, links: int = 24) -> Scene:
    """Return a random planar scene with ``count`` polygons within reach that touch neither start nor goal pose.

    Args:
        seed: seed of the scene.
        count: number of polygons.
        links: number of links of the arm.
    """
    rng = np.random.default_rng(seed)
    arm = make_arm(links)
    start = clear_headings(rng, arm)
    goal = clear_headings(rng, arm)
    poses = shapely.MultiLineString([arm.joint_positions(pose) for pose in (start, goal)])
    obstacles: list[Obstacle] = []
    while len(obstacles) < count:
        polygon = random_polygon(rng, rng.uniform(-LENGTH, LENGTH, 2))
        if polygon.distance(poses) > arm.radius + KEPT_OFF:
            obstacles.append(Obstacle(f"polygon {len(obstacles)}", PlaneShape(polygon)))
    return Scene(arm, Workspace(ROOM, tuple(obstacles)), start, goal)


def open_space(seed: int, links: int = 24) -> Scene:
    """Return a planar scene without obstacles, from the straight arm to a random pose (section 3 of the paper).

    Args:
        seed: seed of the goal pose.
        links: number of links of the arm.
    """
    rng = np.random.default_rng(seed)
    arm = make_arm(links)
    return Scene(arm, Workspace(ROOM), np.zeros(links), clear_headings(rng, arm))


def corridor(seed: int, width: float = 0.1, links: int = 24) -> Scene:
    """Return a planar scene with a horizontal duct at a random height, into which the arm must move its end.

    Args:
        seed: seed of the scene.
        width: width of the duct [m].
        links: number of links of the arm.
    """
    rng = np.random.default_rng(seed)
    arm = make_arm(links)
    height = rng.uniform(-0.2, 0.2)
    mouth = rng.uniform(0.45, 0.55)
    obstacles = (
        Obstacle("duct, top", PlaneShape(shapely.box(mouth, height + 0.5 * width, 1.1, height + 0.5 * width + 0.1))),
        Obstacle("duct, bottom", PlaneShape(shapely.box(mouth, height - 0.5 * width - 0.1, 1.1, height - 0.5 * width))),
    )
    start = np.full(links, rng.choice((-1.0, 1.0)) * rng.uniform(1.3, 1.9))
    return Scene(arm, Workspace(ROOM, obstacles), start, _into_duct(arm, height))


def _into_duct(arm: Arm, height: float) -> FloatArray:
    """Return the headings of an S-shaped pose whose tip is horizontal at a given height [m], shape (links,) [rad]."""
    middles = (np.arange(arm.links) + 0.5) / arm.links
    hump = np.where(middles < 0.45, np.sin(np.pi * middles / 0.45), 0.0)
    # The wanted height lies between those of the full pose downwards and upwards.
    scale = brentq(lambda x: arm.joint_positions(x * hump)[-1, 1] - height, -1.0, 1.0)
    pose: FloatArray = scale * hump
    return pose


SHARED = "shared"
"""Name of the suite of planar example problems that come with the package."""
ON_AXIS = "feed-"
"""Prefix of the file names of example problems with a feed axis, which are left out, since the paper's planner does not
support one."""
GENERATOR = 1
"""Version of the generator of random scenes, part of the fingerprint of every random problem."""
DEFAULT_COUNT = 20
"""Default number of problems from a random suite."""

SUITES: Mapping[str, Callable[[int], Scene]] = {
    "open-space": open_space,
    **{f"clutter-{count}": partial(clutter, count=count) for count in (20, 40, 80)},
    "duct": corridor,
}
"""Functions that make a scene from a seed, by name of the suite; ``clutter-N`` also exists for other numbers N."""
_CLUTTER = re.compile(r"clutter-(\d{1,4})")


@dataclass(frozen=True)
class Case:
    """One problem of a comparison; random problems are generated from their seed by the process that solves them.

    Attributes:
        name: name of the problem, unique within a comparison.
        suite: name of the suite; "files" for a problem file.
        seed: seed of a random problem.
        given: problem read from a file; None for a random problem.
        fingerprint: text that distinguishes different problems of the same name.
    """

    name: str
    suite: str
    seed: int = 0
    given: Problem | None = field(default=None, compare=False)
    fingerprint: str = field(default="")

    def problem(self) -> Problem:
        """Return the problem, generated from its seed if it is random."""
        if self.given is not None:
            return self.given
        return problem_maker(self.suite)(self.seed, self.name)


def problem_maker(suite: str) -> Callable[[int, str], Problem]:
    """Return the function that makes a problem of a random suite, given seed and name of the problem.

    Args:
        suite: name of a suite, or a reference ``module:attribute`` to such a function.

    Raises:
        ProblemError: no suite has this name.
    """
    if ":" in suite:
        module, _, attribute = suite.partition(":")
        try:
            maker: Callable[[int, str], Problem] = getattr(import_module(module), attribute)
        except (ImportError, AttributeError) as error:
            raise ProblemError(f"the suite '{suite}' cannot be loaded: {error}") from error
        return maker
    if polygons := _CLUTTER.fullmatch(suite):
        return lambda seed, name: clutter(seed, int(polygons[1])).problem(name=name)
    if suite in SUITES:
        return lambda seed, name: SUITES[suite](seed).problem(name=name)
    found = _NAME.fullmatch(suite)
    links = int(found["links"] or USUAL_LINKS) if found else 0
    if found is None or links < 2 or links % 2:
        names = ", ".join(SPACE_SUITES if suite.startswith(SPACE) else (SHARED, *SUITES, *SPACE_SUITES))
        raise ProblemError(
            f"there is no suite '{suite}'; expected one of {names}, or clutter-N with N polygons, in space "
            "N solids; in space each may end in -L-links, with an even L; or module:attribute"
        )
    if found["job"]:
        return lambda seed, name: disturbed_job(seed, found["job"], links, shared_folder() / "space", name)
    return lambda seed, name: space_clutter(seed, int(found["count"]), links, name)


def suite_cases(suite: str, count: int | None = None, first_seed: int = 0) -> tuple[Case, ...]:
    """Return problems of a suite, random ones not yet generated.

    Args:
        suite: name of the suite.
        count: number of problems; None for all example problems, or ``DEFAULT_COUNT`` random ones.
        first_seed: seed of the first random problem; the others have the following seeds.

    Raises:
        ProblemError: no suite has this name, or the suite has fewer problems.
    """
    if suite == SHARED:
        files = sorted(shared_folder().glob("*.toml"))
        cases = cases_from_files([file for file in files if not file.name.startswith(ON_AXIS)])
        if count is not None and count > len(cases):
            raise ProblemError(f"the suite '{SHARED}' has {len(cases)} problems, but --count asks for {count}")
        return cases[:count]
    problem_maker(suite)
    # No scene is made yet: workers make their own, so that only the seed is sent to them.
    wanted = DEFAULT_COUNT if count is None else count
    seeds = range(first_seed, first_seed + wanted)
    code = f"{GENERATOR}" if ":" not in suite else code_of(suite)
    name = suite.rpartition(":")[2]
    return tuple(Case(f"{name}-{seed}", suite, seed, fingerprint=f"{code}:{suite}:{seed}") for seed in seeds)


def cases_from_files(files: Sequence[Path], *, allow_outside: bool = False) -> tuple[Case, ...]:
    """Return the problems in problem files as cases of a comparison.

    Args:
        files: the files.
        allow_outside: whether drawings and meshes may lie outside the folders of the files.

    Raises:
        ProblemError: a file is invalid.
    """
    cases = []
    for file in files:
        problem = load_problem(file, allow_outside=allow_outside)
        fingerprint = _content_hash(problem)
        cases.append(Case(name=problem.name, suite="files", given=problem, fingerprint=fingerprint))
    return tuple(cases)


def _content_hash(problem: Problem) -> str:
    """Return a hash of a problem, including drawings and meshes, so that an edited file counts as another problem."""
    return hashlib.sha256(strict_text(problem_data(problem)).encode()).hexdigest()


def distinct(cases: Sequence[Case]) -> tuple[Case, ...]:
    """Return cases of a comparison without duplicates.

    Raises:
        ProblemError: two different problems have the same name.
    """
    kept: dict[str, Case] = {}
    for case in cases:
        # A problem may be given twice, but two problems of one name could not be told apart in tables.
        same_name = kept.setdefault(case.name, case)
        if same_name.fingerprint != case.fingerprint:
            raise ProblemError(f"two different problems have the name '{case.name}'; rename one")
    return tuple(kept.values())


def shared_folder() -> Path:
    """Return the folder of the example problems, in the installed package or in its source tree."""
    installed = Path(__file__).with_name("problems")
    return installed if installed.is_dir() else Path(__file__).parents[3] / "problems"
