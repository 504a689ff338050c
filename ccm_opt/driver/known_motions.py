"""Certified motions that are known between the goals of a tour, and the fastest ways over them.

Motions lead from rest to rest, backwards as forwards, since limits are symmetric. Between two goals without a known
motion, the fastest way over goals with known ones counts, on which the arm rests there.

Known motions pass near each other, above all through one passage. Their configurations are poses of a roadmap
(``pose_roadmap``), whose ways change from one motion to another where these are near. How long such a way takes is
estimated before it has a certificate.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import shortest_path

from ccm_opt.core.arrays import TINY, FloatArray, IntArray
from ccm_opt.core.deadline import Deadline
from ccm_opt.core.errors import NoPlanFound
from ccm_opt.core.polyline import points_at
from ccm_opt.driver.legs import LEAST_TIME, Leg, Planner, end_to_end
from ccm_opt.driver.pose_roadmap import PoseRoadmap
from ccm_opt.planning.joining import PathJoiner, chain_time
from ccm_opt.planning.search import clearance_cost
from ccm_opt.problem import JointPose, Problem, Stop, Tolerances
from ccm_opt.problem.solution import JointPath

_SAMPLES = 12
"""Number of configurations of a chain for each keyframe of a path. Heuristic."""
_NEIGHBOURS = 8
"""Number of nearest goals to which a straight motion is tried. Heuristic: one that fails takes a hundredth of a second,
and of thirty views in a blade row few beyond the tenth are reached straight."""
_POSES = 300
"""Number of configurations of known motions in the roadmap, about. Heuristic."""
_SLOWER = 1.1
"""Ratio of the durations of a motion and of the way over the roadmap from which it is made, without its ramps.
Heuristic: 1.0 to 1.3 between views in a blade row."""
_TRY_SHARE = 0.2
"""Fraction of the time left that a motion planned by itself may take. Heuristic."""
_LACK = 0.1
"""Clearance that a motion has to lack on the way to be planned by itself, as a fraction of the preferred one.
Heuristic: joined motions keep nine tenths of the clearance of those that they join."""
_UNTIMED = 1e6
"""Cost of a motion that cannot be timed [s]."""


@dataclass(frozen=True, eq=False)
class Rest:
    """A pose in which the arm rests, as a node of the tree of motions.

    Attributes:
        number: index of the goal in the problem; −1 for the start and for goals of other problems.
        stop: the goal.
        q: the configuration, shape (c,) [rad, m].
        parent: index of the node from which it is reached; −1 for the start.
        path: path from the parent; None for the start.
    """

    number: int
    stop: Stop
    q: FloatArray
    parent: int = -1
    path: JointPath | None = None


@dataclass(eq=False)
class KnownMotions:
    """Known motions between the start and the goals that were reached.

    Attributes:
        problem: the problem, with ``planner.order = "free"``.
        planner: planner of motions to single goals.
        time: function that returns the duration of a leg [s]; raises ``NoPlanFound`` if it cannot be timed.
        share: fraction of the limits of velocity and acceleration that motions use at most.
        chain: function that returns configurations between which motions are certified, from one configuration (c,) to
            another one, shape (K, c); None if it knows none.
        rests: the start and the goals that were reached, nodes of the tree.
        paths: known paths between nodes, the lower one first.
        durations: their durations [s].
        joined: pairs of nodes between which the fastest way was shortened.
        planned: pairs of nodes between which a motion was planned by itself.
        linked: pairs of nodes between which a way over the roadmap was tried.
        roadmap: the configurations of known motions, those of the nodes first; None before there are any.
    """

    problem: Problem
    planner: Planner
    time: Callable[[Leg], float]
    share: float
    chain: Callable[[FloatArray, FloatArray], FloatArray | None] = lambda _first, _last: None
    rests: list[Rest] = field(default_factory=list)
    paths: dict[tuple[int, int], JointPath] = field(default_factory=dict)
    durations: dict[tuple[int, int], float] = field(default_factory=dict)
    joined: set[tuple[int, int]] = field(default_factory=set)
    planned: set[tuple[int, int]] = field(default_factory=set)
    linked: set[tuple[int, int]] = field(default_factory=set)
    roadmap: PoseRoadmap | None = None

    def __post_init__(self) -> None:
        problem = self.problem
        limits = problem.limits.of_coordinates(problem.arm.coordinates)
        self._speed, self._acceleration = self.share * limits.velocity, self.share * limits.acceleration
        self._joiner = PathJoiner(problem, np.where(np.isfinite(self._speed), self._speed, 1e6))
        self.rests = [Rest(-1, Stop(problem.start, Tolerances()), problem.start.configuration(problem.arm))]

    def leg_problem(self, begin: Rest, stop: Stop) -> Problem:
        """Return the problem of moving from a pose at rest to a goal."""
        start = self.problem.start
        if begin.parent >= 0:
            start = JointPose.from_configuration(begin.q, self.problem.arm.coordinates)
        return replace(
            self.problem,
            start=start,
            goal=stop.goal,
            tolerances=stop.tolerances,
            stops=(),
            pause=0.0,
            planner=replace(self.problem.planner, order="given", end="free"),
        )

    def keep(self, first: int, second: int, path: JointPath) -> bool:
        """Keep the path between two nodes, the lower one first, if it is the fastest known, and return whether it is.

        It is not kept if it cannot be timed.
        """
        problem = self.leg_problem(self.rests[first], self.rests[second].stop)
        try:
            duration = self.time(Leg(problem, path))
        except NoPlanFound:
            duration = _UNTIMED
        fastest = duration < self.durations.get((first, second), np.inf)
        if fastest:
            self.paths[first, second], self.durations[first, second] = path, duration
        return fastest

    def join_neighbours(self) -> None:
        """Keep the motions of the tree, and straight ones between neighbours that have a certificate."""
        for k, rest in enumerate(self.rests[1:], start=1):
            assert rest.path is not None  # noqa: S101 - all nodes but the start have one
            self.keep(rest.parent, k, rest.path)
        near = np.argsort(self.bounds, axis=1, kind="stable")[:, : _NEIGHBOURS + 1]
        pairs = {(min(k, other), max(k, other)) for k, row in enumerate(near.tolist()) for other in row if other != k}
        for first, second in sorted(pairs - self.paths.keys()):
            straight = self._joiner.path(np.stack((self.rests[first].q, self.rests[second].q)))
            if straight is not None:
                self.keep(first, second, straight)

    def make_roadmap(self) -> None:
        """Make the roadmap of the known motions."""
        pace = self._joiner.pace
        self.linked.clear()
        self.roadmap = PoseRoadmap(self._joiner.joins, pace, np.stack([rest.q for rest in self.rests]))
        step = sum(self.durations.values()) / _POSES
        for (first, second), path in self.paths.items():
            rows = np.asarray(path.spline(np.linspace(0.0, 1.0, _SAMPLES * len(path.keyframes) + 1)))
            rows[[0, -1]] = self.rests[first].q, self.rests[second].q
            time = chain_time(rows, pace)
            at = np.linspace(0.0, time[-1], max(round(float(time[-1]) / step), 1) + 1)
            even = points_at(rows, time, at)
            even[[0, -1]] = rows[[0, -1]]
            self.roadmap.add_motion(first, second, even)
        self.roadmap.find_neighbours()

    def estimated(self, between: FloatArray) -> FloatArray:
        """Return durations of ways (nodes, nodes), lowered to estimates of ways over the roadmap that were not tried.

        Args:
            between: durations of the fastest known ways, shape (nodes, nodes) [s].
        """
        if self.roadmap is None:
            return between
        ramps = float(np.min(self._speed / self._acceleration))
        found = np.maximum(_SLOWER * self.roadmap.estimates(len(between)) + ramps, self.bounds)
        for pair in self.linked:
            found[pair] = found[pair[::-1]] = np.inf
        np.fill_diagonal(found, 0.0)
        return np.minimum(between, found)

    def link(self, first: int, second: int) -> bool:
        """Keep the way over the roadmap between two nodes, the lower one first, and return whether it gains time."""
        self.linked.add((first, second))
        chain = None if self.roadmap is None else self.roadmap.chain(self.rests[first].q, self.rests[second].q)
        path = None if chain is None or len(chain) == 1 else self._joiner.path(chain)
        return path is not None and self.keep(first, second, path)

    def fastest(self) -> tuple[FloatArray, IntArray]:
        """Return the durations of the fastest ways over known motions between all nodes, and the nodes before the last.

        Returns:
            Durations [s], and for each pair of nodes the last node but one on the way, both of shape (nodes, nodes).
        """
        count = len(self.rests)
        first, second = np.array(list(self.durations)).T
        # In a dense matrix, next to nothing would mean that there is no motion.
        durations = np.maximum(list(self.durations.values()), TINY)
        known = csr_array((durations, (first, second)), shape=(count, count))
        between, before = shortest_path(known, directed=False, return_predecessors=True)
        return between, before.astype(np.intp)

    def way(self, before: IntArray, first: int, second: int) -> list[JointPath]:
        """Return the known paths of the fastest way between two nodes, each in the direction of travel."""
        nodes = [second]
        while nodes[-1] != first:
            nodes.append(int(before[first, nodes[-1]]))
        return [
            self.paths[one, other] if one < other else self.paths[other, one].reversed()
            for one, other in pairwise(nodes[::-1])
        ]

    def shorten(self, way: list[JointPath], first: int, second: int, duration: float) -> bool:
        """Shorten the fastest way between two nodes, the lower one first, and return whether that gains time.

        Args:
            way: known paths of the way.
            first: the node at which it begins.
            second: the node at which it ends.
            duration: its duration [s].
        """
        self.joined.add((first, second))
        # The way from the start to a goal is kept as it was planned, with its clearance.
        if first == 0 and len(way) == 1:
            return False
        if len(way) > 1:
            self.paths[first, second], self.durations[first, second] = end_to_end(way), duration
        rows = np.vstack([part.spline(np.linspace(0.0, 1.0, _SAMPLES * len(part.keyframes) + 1)) for part in way])
        rows[[0, -1]] = self.rests[first].q, self.rests[second].q
        joined = self._joiner.path(rows)
        return joined is not None and self.keep(first, second, joined)

    def plan(self, first: int, second: int, deadline: Deadline) -> bool:
        """Plan for the motion between two nodes, the lower one first, by itself, and return whether that gains time."""
        self.planned.add((first, second))
        end = JointPose.from_configuration(self.rests[second].q, self.problem.arm.coordinates)
        problem = self.leg_problem(self.rests[first], Stop(end, Tolerances()))
        limit = max(_TRY_SHARE * deadline.left, LEAST_TIME)
        try:
            path = self.along_chain(self.rests[first].q, self.rests[second].q)
            path = path or self.planner.plan(replace(problem, planner=replace(problem.planner, time_limit=limit)))
        except NoPlanFound:
            return False
        return self.keep(first, second, path)

    def along_chain(self, first: FloatArray, last: FloatArray) -> JointPath | None:
        """Return a path between two configurations (c,) along a chain of certified motions, or None."""
        chain = self.chain(first, last)
        return None if chain is None or len(chain) == 1 else self._joiner.path(chain)

    def leg(self, before: IntArray, one: int, other: int) -> Leg:
        """Return the leg from one node to another on the fastest known way."""
        problem = self.leg_problem(self.rests[one], self.rests[other].stop)
        return Leg(problem, end_to_end(self.way(before, one, other)))

    # ------------------------------------------------------------ clearance
    def with_more_clearance(self, leg: Leg, deadline: Deadline) -> Leg:
        """Return a leg planned by itself if it lacks clearance that its ends have and that costs less, or the leg."""
        lack = self._joiner.lack(leg.path)
        if np.max(lack) - np.max(lack[[0, -1]]) < _LACK or deadline.passed():
            return leg
        start, end = (JointPose.from_configuration(q, leg.problem.arm.coordinates) for q in leg.path.spline([0.0, 1.0]))
        options = replace(leg.problem.planner, time_limit=max(_TRY_SHARE * deadline.left, LEAST_TIME))
        try:
            asked = replace(leg.problem, start=start, goal=end, tolerances=Tolerances(), planner=options)
            other = replace(leg, path=self.planner.plan(asked))
            return min(leg, other, key=lambda each: self.cost((each,), self.time(each)))
        except NoPlanFound:
            return leg

    def cost(self, legs: Sequence[Leg], duration: float) -> float:
        """Return the cost of legs by their duration and the clearance that they lack [s]; see ``clearance_cost``."""
        return clearance_cost(duration, max(float(np.max(self._joiner.lack(leg.path))) for leg in legs))

    @property
    def bounds(self) -> FloatArray:
        """Lower bounds on the durations of motions between nodes from rest to rest, shape (nodes, nodes) [s]."""
        q = np.stack([rest.q for rest in self.rests])
        away = np.abs(q[:, None] - q[None])
        speed, acceleration = self._speed, self._acceleration
        # Of each coordinate by itself, with the greatest rates: to and from its speed limit, or less if it is near.
        fast = away / speed + speed / acceleration
        slow = 2.0 * np.sqrt(away / acceleration)
        return np.asarray(np.max(np.where(away * acceleration > speed**2, fast, slow), axis=2))
