"""Search strategy among many walls that leads the tip of a planar arm along random paths.

Routes from the base, shortest first, seldom lead along the arm's current shape, since among many walls there are
hundreds of routes hardly longer than the shortest. But the arm stays in its homotopy class, and when the tip is
retracted, the surplus length of the arm bows out between the walls.

Leading a tip takes a twentieth of a second, and it cannot be predicted with which margin, and on which side of each
wall, the arm passes. So the tip is led many times (each time is called a walk): first along the arm's shape and along
the shortest path, then via random points, from the start and from the ends of other walks.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from ccm_opt.core.arrays import SHORTEST, FloatArray
from ccm_opt.core.errors import UnreachableGoal
from ccm_opt.core.length_words import long_length
from ccm_opt.core.polyline import path_length, unit_vector
from ccm_opt.planning.continuation import GuideCandidate, Stalled, follow, settle
from ccm_opt.planning.curve_routes import run_in
from ccm_opt.planning.goal import GoalPose
from ccm_opt.planning.hairpin import FOLD_LENGTHS, led_along, pulled_over
from ccm_opt.planning.motion import Motion
from ccm_opt.planning.motion_task import MotionTask
from ccm_opt.planning.pose import Pose
from ccm_opt.planning.search import Failure
from ccm_opt.planning.search_run import PlanarRun, stack_configurations
from ccm_opt.planning.settings import TipWalkSettings
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.rigid_motions import NOMINAL_LINKS
from ccm_opt.scene.free_space import FreeSpace

_FARTHEST = 0.3
"""Maximum distance of sampled via points from the tip or goal, as a fraction of the arm's length. Heuristic."""
_PLACES_DRAWN = 16
"""Number of points sampled at once to find a free one. Heuristic."""
_NEARNESS = 0.17
"""Scale of distance from the goal: a walk begins 1/e times as often at a tip this far from the goal as at one at the
goal, as a fraction of the arm's length. Heuristic."""

_FROM_START = 0.35
"""Probability that a walk begins at the start, and not at the end of another walk. Measured: fewer fields of obstacles
are solved with 0.1, and also with 1."""
_ONTO_GOAL = 0.7
"""Probability that a walk leads on to the goal, and not only to a random point. Heuristic."""
_BY_PLACE = 0.85
"""Probability that a walk to the goal leads via a random point, which decides on which side walls are passed.
Heuristic."""
_ABOUT_GOAL = 0.7
"""Probability that random points are sampled around the goal, and not around the tip. Heuristic."""
_NEAREST = 0.05
"""Minimum distance of sampled via points from the tip or goal, as a fraction of the arm's length. Heuristic."""
_ROUNDING = (0.5, 1.0, 2.0)
"""Distances that tip paths keep from obstacle corners, one sampled for each walk, as multiples of the usual distance.
Measured: with several the mean time to a solution was 3.3 s instead of 4.1."""


@dataclass(frozen=True)
class TipWays:
    """Sampler of tip paths that are shortest in their homotopy class and approach the goal straight along its heading.

    Attributes:
        arm: the arm.
        free_space: free space of the tip, in which the base of the arm is a point obstacle.
        goal: goal of the tip.
        shrink: distance that tip paths keep from obstacle corners where possible [m].
        settings: settings of the walks.
    """

    arm: Arm
    free_space: FreeSpace
    goal: GoalPose
    shrink: float
    settings: TipWalkSettings

    def straight_on(self, pose: Pose) -> FloatArray | None:
        """Return the tip path from a pose that leads first back along the arm and then to the goal, (k, 2) [m].

        It leaves the arm at the joint nearest to the goal and is shortened within its homotopy class; None if blocked.
        """
        entry, place = self._run_in(pose)
        nearest = int(np.argmin(np.linalg.norm(pose.points - entry, axis=1)))
        back = pose.points[max(nearest, 1) :][::-1]
        return self._led_onto(np.vstack((back, entry)), place, self.shrink)

    def sample_path(self, pose: Pose, rng: np.random.Generator) -> tuple[FloatArray | None, bool]:
        """Return a random tip path from a pose, and whether it leads onto the goal.

        Returns:
            The path, shape (k, 2) [m], None if it is blocked; and whether it leads onto the goal, not to a random
            point.
        """
        entry, place = self._run_in(pose)
        tip = pose.points[-1:]
        shrink = self.shrink * float(rng.choice(_ROUNDING))
        onto_goal = bool(rng.random() < _ONTO_GOAL)
        if onto_goal and rng.random() >= _BY_PLACE:
            return self._led_onto(np.vstack((tip, entry)), place, shrink), True
        middle = place if rng.random() < _ABOUT_GOAL else tip[0]
        via = self._free_place(middle, rng)
        if not onto_goal:
            return self._led_onto(np.vstack((tip, via)), via, shrink), False
        return self._led_onto(np.vstack((tip, via, entry)), place, shrink), True

    def _led_onto(self, polyline: FloatArray, place: FloatArray, shrink: float) -> FloatArray | None:
        """Return the shortest path in the homotopy class of a polyline (m, 2), continued to a point (2,), (k, 2) [m].

        The result is None if the polyline is blocked. ``shrink`` is the distance kept from obstacle corners [m].
        """
        try:
            taut = self.free_space.taut_path(polyline, shrink)
        except UnreachableGoal:
            return None
        return taut if np.array_equal(taut[-1], place) else np.vstack((taut, place))

    def _run_in(self, pose: Pose) -> tuple[FloatArray, FloatArray]:
        """Return first and last point of the straight approach to the goal, each of shape (2,) [m].

        If the goal is a set, the approach leads to its member nearest to the pose.
        """
        member = self.goal.nearest_member(pose.tip, pose.tip_direction)
        length = self.arm.length / NOMINAL_LINKS
        return run_in(self.free_space, member.position, member.heading, length), member.position

    def _free_place(self, middle: FloatArray, rng: np.random.Generator) -> FloatArray:
        """Return a random point near a given one, shape (2,) [m]; it is not free if none of several samples is."""
        angles = rng.uniform(-np.pi, np.pi, _PLACES_DRAWN)
        distances = self.arm.length * rng.uniform(_NEAREST, _FARTHEST, _PLACES_DRAWN)
        places = middle + distances[:, None] * unit_vector(angles)
        reached = np.linalg.norm(places - self.arm.base, axis=1) < self.arm.length
        free = np.flatnonzero(self.free_space.contains(places) & reached)
        return np.asarray(places[free[0] if len(free) else 0])


WALKS = "random tip paths"
"""Candidate name of motions found by random walks of the tip."""


def is_walked(task: MotionTask) -> bool:
    """Return whether random walks of the tip are tried for a task: many walls near, and a goal for the tip alone."""
    fits = not task.parametric and task.goal_pose is None
    return fits and task.among_many_walls and len(task.tip_paths) > 0


def find_by_walks(task: MotionTask, failures: list[Failure], *, late: bool = False) -> Motion | None:
    """Return the first certified motion to the goal found by leading the tip among many walls, or None.

    Args:
        task: arm, workspace, start, goal and limits.
        failures: list to which the failures of candidates are appended.
        late: whether this is the second attempt, after all candidates, with other walks than the first.
    """
    settings = task.settings.tip_walks
    runs = [PlanarRun.from_task(task, margin) for margin in settings.margins]
    first = task.tip_paths[0]
    ways = TipWays(task.arm, first.free_space, runs[0].goal, first.shrink, settings)
    if not late:
        for run in runs:
            motion = run.run(_straight_on(run, ways), failures)
            if motion is not None or task.deadline.passed():
                return motion
        # Walks mostly arrive where the tip's path to the goal, along the arm's shape, is short.
        along_arm = ways.straight_on(runs[0].start)
        if along_arm is None or path_length(along_arm) > settings.longest_way * task.arm.length:
            return None
    walks = TipWalks(tuple(runs), ways, np.random.default_rng((task.seed, late)), settings)
    return walks.search(settings.late_walks if late else settings.early_walks, failures)


def _straight_on(run: PlanarRun, ways: TipWays) -> Iterator[GuideCandidate]:
    """Yield guides that lead the tip along the arm's shape to the goal, along the shortest path, and with a fold."""
    shortest = min(run.task.tip_paths, key=lambda path: path.length)
    along_arm = ways.straight_on(run.start)
    if along_arm is not None:
        yield _candidate(run, "as the arm lies", along_arm)
    # The same path, mostly.
    if along_arm is None or abs(path_length(along_arm) - shortest.length) > SHORTEST:
        yield _candidate(run, "the shortest", shortest.taut)
    lengths = FOLD_LENGTHS[:1]
    yield from pulled_over(run.stepper, run.start, None, shortest, lengths)


def _candidate(run: PlanarRun, which: str, taut: FloatArray) -> GuideCandidate:
    name = f"tip-led, {which}, path of {long_length(path_length(taut))}"
    return GuideCandidate(name, partial(led_along, run.stepper, taut))


@dataclass
class PoseTree:
    """Search tree of poses of an arm, with the motions between them.

    Attributes:
        poses: pose of each node.
        parents: index of the parent of each node, -1 for the root.
        edges: for each node, poses of the motion from the parent to the node, without that of the parent.
        uses: number of times that each node has been chosen for an extension.
    """

    poses: list[Pose] = field(default_factory=list)
    parents: list[int] = field(default_factory=list)
    edges: list[list[Pose]] = field(default_factory=list)
    uses: list[int] = field(default_factory=list)

    def __len__(self) -> int:
        return len(self.poses)

    def add(self, parent: int, edge: list[Pose]) -> int:
        """Add the last pose of a motion as a node, and return the index of the node.

        Args:
            parent: index of the node at which the motion begins, -1 for the root.
            edge: poses of the motion after that of the parent.
        """
        self.poses.append(edge[-1])
        self.parents.append(parent)
        self.edges.append(edge)
        self.uses.append(0)
        return len(self) - 1

    def tip_distances(self, place: FloatArray) -> FloatArray:
        """Return the distance of the tip of every node to a point (2,), shape (nodes,) [m]."""
        distances: FloatArray = np.linalg.norm(np.array([node.tip for node in self.poses]) - place, axis=1)
        return distances

    def poses_to_node(self, node: int) -> list[Pose]:
        """Return all poses of the motion from the root to a node."""
        edges = []
        while node >= 0:
            edges.append(self.edges[node])
            node = self.parents[node]
        return [pose for edge in reversed(edges) for pose in edge]


@dataclass
class TipWalks:
    """Search by random walks of the tip, which begin at the start or at the end of an earlier walk.

    Attributes:
        runs: searches of one task with different planning margins.
        ways: sampler of tip paths.
        rng: source of every random choice.
        settings: settings of the walks.
        reached: tree of the start and the last certified pose of every walk.
    """

    runs: tuple[PlanarRun, ...]
    ways: TipWays
    rng: np.random.Generator
    settings: TipWalkSettings
    reached: PoseTree = field(init=False, default_factory=PoseTree)

    def __post_init__(self) -> None:
        self.reached.add(-1, [self.runs[0].start])

    def search(self, walks: int, failures: list[Failure]) -> Motion | None:
        """Return the certified motion of the first walk that reaches the goal, or None after ``walks`` walks.

        A failure is then appended to ``failures``.
        """
        run = self.runs[0]
        for _ in range(walks):
            if run.task.deadline.passed():
                break
            arrived = self._walk()
            if arrived is not None:
                try:
                    return run.motion(WALKS, run.certified_without_pauses(arrived))
                except Stalled:
                    continue  # this motion can hardly be certified; another may have more clearance
        nearest = min(self.reached.poses, key=lambda pose: run.goal.errors(pose)[0])
        failures.append(
            run.failure(WALKS, Stalled(f"{walks} random paths of the tip did not reach the goal", [nearest]))
        )
        return None

    def _walk(self) -> list[Pose] | None:
        """Return all poses from the start to the goal after one more walk, or None if the walk does not arrive."""
        node = self._beginning()
        begin = self.reached.poses[node]
        run = self.runs[int(self.rng.integers(len(self.runs)))]
        taut, onto_goal = self.ways.sample_path(begin, self.rng)
        if taut is None:
            return None
        poses, arrived = self._led(run, begin, taut, onto_goal=onto_goal)
        if len(poses) < 2:
            return None
        failing = run.task.certificate.failures(stack_configurations(poses))
        if arrived and onto_goal and len(failing) == 0:
            return [*self.reached.poses_to_node(node), *poses[1:]]
        certified = poses[: int(failing[0]) + 1] if len(failing) else poses
        if len(certified) > 1:
            self.reached.add(node, certified[1:])
        return None

    def _led(self, run: PlanarRun, begin: Pose, taut: FloatArray, *, onto_goal: bool) -> tuple[list[Pose], bool]:
        """Return the poses of a walk with the tip led along a path, and whether the path was followed to its end.

        If the goal is a set, the tip stops as soon as it is inside.

        Args:
            run: search with a planning margin.
            begin: pose at which the walk begins.
            taut: path of the tip, shape (k, 2) [m].
            onto_goal: whether the tip is settled on the goal at the end.
        """
        poses = [begin]
        guide = led_along(run.stepper, taut)
        try:
            poses = follow(run.stepper, guide, begin, run.task.deadline, into=run.goal)
            if onto_goal:
                poses = poses + settle(run.stepper, run.goal, poses[-1], run.task.deadline)[1:]
        except Stalled as stalled:
            return poses + stalled.poses[1:], False
        return poses, True

    def _beginning(self) -> int:
        """Return the index in ``reached`` of the node at which the next walk begins: the start or a random other node.

        Nodes that are near the goal and have seldom been used are preferred.
        """
        if self.rng.random() < _FROM_START:
            return 0
        reached = self.reached
        distances = reached.tip_distances(self.runs[0].goal.position) / self.ways.arm.length
        weights = np.exp(-distances / _NEARNESS) / (1.0 + np.array(reached.uses))
        node = int(self.rng.choice(len(reached), p=weights / weights.sum()))
        reached.uses[node] += 1
        return node
