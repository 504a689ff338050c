"""Planning of a motion to several goals in the order that takes least time.

A tree of certified motions grows from the start: the goal next to any goal of the tree is planned for from there or, if
that fails, from the start. Where the arm comes to rest, it stays for this goal. Neighbours are also joined by straight
motions where these have a certificate. Between two goals the arm moves along known motions, shortened by certified
straight ones (``planning.joining``), and backwards as forwards, since limits are symmetric.

Between two goals without a known motion, the fastest way over goals with known ones counts, on which the arm rests
there. The best order for these durations is determined (``tour_order``), its ways are shortened to motions of their
own, slow ones are planned for by themselves, and so on until nothing changes. Then no order of the motions found is
faster. The bound that is told is that of all orders in which, between goals without a known motion, each coordinate
moves by itself. A few goals are also planned leg by leg in this order, and in the given one, as goals in given order
are; the fastest motion is taken.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np
from scipy.sparse.csgraph import shortest_path

from ccm_opt.core.arrays import TINY, FloatArray, IntArray
from ccm_opt.core.deadline import Deadline
from ccm_opt.core.errors import Diagnosis, NoPlanFound, UnreachableGoal
from ccm_opt.core.progress import Stages
from ccm_opt.driver.legs import LEAST_TIME, Leg, Planner, end_to_end, plan_legs
from ccm_opt.driver.tour_order import OrderSolver, tour_cost, tour_legs
from ccm_opt.planning.joining import PathJoiner
from ccm_opt.problem import JointPose, Problem, Stop, Tolerances
from ccm_opt.problem.solution import JointPath, Tour, UnvisitedGoal

_TIME_SHARE = 3.0
"""Time that a goal may take, as a multiple of an equal share of what is left. Heuristic: most goals take less."""
_OTHER_STARTS = 2
"""Number of goals of the tree from which a goal is planned for again that was not reached at first. Heuristic."""
_SAMPLES = 12
"""Number of configurations of a chain for each keyframe of a path. Heuristic."""
_NEIGHBOURS = 8
"""Number of nearest goals to which a straight motion is tried. Heuristic: one that fails takes a hundredth of a second,
and of thirty views in a blade row few beyond the tenth are reached straight."""
_WORTH = 0.01
"""Time that a motion has to lose against its lower bound to be planned for by itself, as a fraction of the duration of
the tour. Heuristic."""
_PLANNING_SHARE = 0.75
"""Fraction of the time limit until which motions are planned for by themselves. Heuristic."""
_TRY_SHARE = 0.2
"""Fraction of the time left that one of them may take. Heuristic."""
_FEW = 12
"""Number of goals up to which the order found, and the given one, are planned leg by leg as well. Heuristic."""
_UNTIMED = 1e6
"""Cost of a motion that cannot be timed [s]."""


@dataclass(frozen=True, eq=False)
class _Rest:
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
class TourPlanner:
    """Plans the tour of one problem.

    Attributes:
        problem: the problem, with ``planner.order = "free"``.
        planner: planner of motions to single goals.
        time: function that returns the duration of a leg [s]; raises ``NoPlanFound`` if it cannot be timed.
        refuse: function that raises ``UnreachableGoal`` if a problem with one goal is proved to have no plan.
        stages: clock that names and times the stages.
        share: fraction of the limits of velocity and acceleration that motions use at most.
        rests: the start and the goals that were reached, nodes of the tree.
        failures: errors of the goals that were not, by index.
        paths: known paths between nodes, the lower one first.
        durations: their durations [s].
        joined: pairs of nodes between which the fastest way was shortened.
        planned: pairs of nodes between which a motion was planned by itself.
        poses: known configurations at goals, by index of the goal, each of shape (c,).
    """

    problem: Problem
    planner: Planner
    time: Callable[[Leg], float]
    refuse: Callable[[Problem], None]
    stages: Stages
    share: float
    rests: list[_Rest] = field(default_factory=list)
    failures: dict[int, NoPlanFound] = field(default_factory=dict)
    paths: dict[tuple[int, int], JointPath] = field(default_factory=dict)
    durations: dict[tuple[int, int], float] = field(default_factory=dict)
    joined: set[tuple[int, int]] = field(default_factory=set)
    planned: set[tuple[int, int]] = field(default_factory=set)
    poses: dict[int, FloatArray] = field(default_factory=dict)

    def __post_init__(self) -> None:
        problem = self.problem
        limits = problem.limits.of_coordinates(problem.arm.coordinates)
        self._speed, self._acceleration = self.share * limits.velocity, self.share * limits.acceleration
        self._joiner = PathJoiner(problem, np.where(np.isfinite(self._speed), self._speed, 1e6))
        self.rests = [_Rest(-1, Stop(problem.start, Tolerances()), problem.start.configuration(problem.arm))]

    def plan(self) -> tuple[tuple[Leg, ...], Tour]:
        """Return the legs of the tour, and the order of the goals with those that are left out.

        Raises:
            NoPlanFound: no goal is reached, or not the one at which the motion has to end.
        """
        deadline = Deadline.after(self.problem.planner.time_limit)
        legs, tour = self._toured(deadline)
        return self.compared(legs, tour, deadline)

    def _toured(self, deadline: Deadline) -> tuple[tuple[Leg, ...], Tour]:
        """Return the tour over motions of the tree and what joins them; see ``plan``."""
        self._grow(deadline)
        self._refuse_incomplete()
        with self.stages("order"):
            return self._ordered(deadline)

    def plan_also(self, problem: Problem, poses: dict[int, FloatArray]) -> tuple[tuple[Leg, ...], Tour]:
        """Return the tour of other goals of the same arm, over all motions that are known so far.

        Goals that are reached already, told by their identity, are not planned for again.

        Args:
            problem: problem that differs in its goals and time limit only.
            poses: known configurations at the goals, by index of the goal, each of shape (c,).

        Raises:
            NoPlanFound: no goal is reached, or not the one at which the motion has to end.
        """
        number_of = {id(stop.goal): k for k, stop in enumerate(problem.numbered_goals)}
        self.problem, self.poses, self.failures = problem, poses, {}
        self.rests[1:] = [replace(rest, number=number_of.get(id(rest.stop.goal), -1)) for rest in self.rests[1:]]
        return self._toured(Deadline.after(problem.planner.time_limit))

    # ------------------------------------------------------------ the tree
    def _grow(self, deadline: Deadline) -> None:
        """Reach all goals that can be reached, each from the nearest goal that is reached already."""
        goals = self.problem.numbered_goals
        tips = {k: stop.goal.tip(self.problem.arm) for k, stop in enumerate(goals)}
        at = [self.problem.arm.joint_positions_at(self.rests[0].q)[-1]]
        at += [rest.stop.goal.tip(self.problem.arm) for rest in self.rests[1:]]
        left = set(tips) - {rest.number for rest in self.rests}
        while left:
            # The nearest goal and where it is reached from; equal distances are decided by place, not by number.
            away = {k: [float(np.linalg.norm(tips[k] - tip)) for tip in at] for k in left}
            k = min(left, key=lambda k: (min(away[k]), *tips[k].tolist(), k))
            left.discard(k)
            parent = int(np.argmin(away[k]))
            rest = self._reached(k, goals[k], dict.fromkeys((parent, 0)), deadline, len(left))
            if rest is not None:
                self.rests.append(rest)
                at.append(tips[k])
        for k in sorted(self.failures, key=lambda k: tips[k].tolist()):
            if isinstance(self.failures[k], UnreachableGoal) or deadline.passed():
                continue
            near = (
                np.argsort([float(np.linalg.norm(tips[k] - tip)) for tip in at[1:]], kind="stable")[:_OTHER_STARTS] + 1
            )
            rest = self._reached(k, goals[k], [int(parent) for parent in near], deadline, len(self.failures))
            if rest is not None:
                self.rests.append(rest)
                at.append(tips[k])
                del self.failures[k]

    def _reached(
        self, number: int, stop: Stop, parents: Sequence[int] | dict[int, None], deadline: Deadline, later: int
    ) -> _Rest | None:
        """Return the pose in which the arm rests at a goal, with the motion to it; None if there is none.

        Args:
            number: index of the goal in the problem.
            stop: the goal.
            parents: nodes of the tree from which it is planned for, in this order.
            deadline: time at which all planning has to end.
            later: number of goals that are still to be reached.
        """
        self.stages.tell(candidate=f"goal {number + 1}")
        try:
            self.refuse(self._leg_problem(self.rests[0], stop))
        except UnreachableGoal as proved:
            self.failures[number] = proved
            return None
        for parent in parents:
            begin = self.rests[parent]
            limit = max(_TIME_SHARE * deadline.left / (later + _TIME_SHARE), LEAST_TIME)
            # Motions between goals are shortened later; that to the first goal is optimised.
            optimiser = self.problem.planner.optimiser if parent == 0 else "none"
            asked = self._leg_problem(begin, stop)
            asked = replace(asked, planner=replace(asked.planner, time_limit=limit, optimiser=optimiser))
            try:
                path = self._path_to_pose(asked, number) or self.planner.plan(asked)
            except NoPlanFound as failure:
                # The reason from the start is told, from which the goal is planned for last.
                self.failures[number] = failure
                continue
            self.failures.pop(number, None)
            return _Rest(number, stop, np.asarray(path.spline(1.0)), parent, path)
        return None

    def _path_to_pose(self, asked: Problem, number: int) -> JointPath | None:
        """Return a path to the known pose at a goal; None if there is none, or no path is found in half the time."""
        q = self.poses.get(number)
        if q is None:
            return None
        pose = JointPose.from_configuration(q, asked.arm.coordinates)
        options = replace(asked.planner, time_limit=0.5 * asked.planner.time_limit)
        try:
            return self.planner.plan(replace(asked, goal=pose, tolerances=Tolerances(), planner=options))
        except NoPlanFound:
            return None

    def _leg_problem(self, begin: _Rest, stop: Stop) -> Problem:
        """Return the problem of moving from a pose at rest to a goal."""
        start = self.problem.start
        if begin.number >= 0:
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

    def _refuse_incomplete(self) -> None:
        goals = self.problem.numbered_goals
        last = len(goals) - 1
        must_end = self.problem.planner.end == "last" and last in self.failures
        if any(rest.number >= 0 for rest in self.rests) and not must_end:
            return
        number = last if must_end else min(self.failures)
        failure = self.failures[number]
        words = ", at which the motion has to end" if must_end else "; no other goal is reached either"
        found: Diagnosis = failure.diagnosis
        reason = f"goal {number + 1} of {len(goals)}: {found.reason}{words if must_end else ''}"
        if not must_end and len(goals) > 1:
            reason += words
        raise type(failure)(replace(found, reason=reason, evidence={**found.evidence, "goal": number + 1})) from failure

    # ------------------------------------------------------------ known motions
    def _keep(self, first: int, second: int, path: JointPath) -> bool:
        """Keep the path between two nodes, the lower one first, if it is the fastest known, and return whether it is.

        It is not kept if it cannot be timed.
        """
        problem = self._leg_problem(self.rests[first], self.rests[second].stop)
        try:
            duration = self.time(Leg(problem, path))
        except NoPlanFound:
            duration = _UNTIMED
        fastest = duration < self.durations.get((first, second), np.inf)
        if fastest:
            self.paths[first, second], self.durations[first, second] = path, duration
        return fastest

    def _join_neighbours(self) -> None:
        """Keep the motions of the tree, and straight ones between neighbours that have a certificate."""
        for k, rest in enumerate(self.rests[1:], start=1):
            assert rest.path is not None  # noqa: S101 - all nodes but the start have one
            self._keep(rest.parent, k, rest.path)
        near = np.argsort(self._bounds, axis=1, kind="stable")[:, 1 : _NEIGHBOURS + 1]
        pairs = {(min(k, other), max(k, other)) for k, row in enumerate(near.tolist()) for other in row}
        for first, second in sorted(pairs - self.paths.keys()):
            straight = self._joiner.path(np.stack((self.rests[first].q, self.rests[second].q)))
            if straight is not None:
                self._keep(first, second, straight)

    def _fastest(self) -> tuple[FloatArray, IntArray]:
        """Return the durations of the fastest ways over known motions between all nodes, and the nodes before the last.

        Returns:
            Durations [s], and for each pair of nodes the last node but one on the way, both of shape (nodes, nodes).
        """
        count = len(self.rests)
        known = np.zeros((count, count))
        for pair, duration in self.durations.items():
            known[pair] = max(duration, TINY)  # zero means that there is no motion
        between, before = shortest_path(known, directed=False, return_predecessors=True)
        return between, before.astype(np.intp)

    def _way(self, before: IntArray, first: int, second: int) -> list[JointPath]:
        """Return the known paths of the fastest way between two nodes, each in the direction of travel."""
        nodes = [second]
        while nodes[-1] != first:
            nodes.append(int(before[first, nodes[-1]]))
        return [
            self.paths[one, other] if one < other else self.paths[other, one].reversed()
            for one, other in pairwise(nodes[::-1])
        ]

    def _shortened(self, way: list[JointPath], first: int, second: int, duration: float) -> bool:
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
        return joined is not None and self._keep(first, second, joined)

    def _planned(self, first: int, second: int, deadline: Deadline) -> bool:
        """Plan for the motion between two nodes, the lower one first, by itself, and return whether that gains time."""
        self.planned.add((first, second))
        end = JointPose.from_configuration(self.rests[second].q, self.problem.arm.coordinates)
        problem = self._leg_problem(self.rests[first], Stop(end, Tolerances()))
        limit = max(_TRY_SHARE * deadline.left, LEAST_TIME)
        try:
            path = self.planner.plan(replace(problem, planner=replace(problem.planner, time_limit=limit)))
        except NoPlanFound:
            return False
        return self._keep(first, second, path)

    # ------------------------------------------------------------ the order
    def _ordered(self, deadline: Deadline) -> tuple[tuple[Leg, ...], Tour]:
        end = self.problem.planner.end
        # The place at which the tour ends comes last.
        nodes = [0, *(k for k, rest in enumerate(self.rests) if rest.number >= 0)]
        nodes.sort(key=lambda k: end == "last" and self.rests[k].number == len(self.problem.stops))
        places = np.ix_(nodes, nodes)
        solver = OrderSolver(len(nodes), end)
        self._join_neighbours()
        while True:
            between, before = self._fastest()
            found = solver.solve(between[places], deadline)
            legs = [(nodes[one], nodes[other]) for one, other in tour_legs(found.places, end)]
            duration = float(sum(between[leg] for leg in legs))
            if deadline.passed() or not self._improved(legs, between, before, deadline):
                break
        number_of = {self.rests[node].number: k for k, node in enumerate(nodes)}
        as_given = tuple(number_of[number] for number in sorted(number_of) if number >= 0)
        known = np.eye(len(self.rests), dtype=bool)
        for pair in self.paths:
            known[pair] = known[pair[::-1]] = True
        bound = solver.solve(np.where(known, between, self._bounds)[places], deadline).bound
        tour = Tour(
            self.problem,
            tuple(self.rests[nodes[k]].number + 1 for k in found.places),
            tuple(
                UnvisitedGoal(number + 1, failure.status, failure.diagnosis.reason)
                for number, failure in sorted(self.failures.items())
            ),
            duration=duration,
            bound=min(bound, duration),
            as_given=tour_cost(between[places], as_given, end),
        )
        return tuple(self._leg(before, *leg) for leg in legs), tour

    # ------------------------------------------------------------ leg by leg
    def compared(self, legs: tuple[Leg, ...], tour: Tour, deadline: Deadline) -> tuple[tuple[Leg, ...], Tour]:
        """Return the fastest of a tour, of the same order planned leg by leg, and of the given order likewise.

        Leg by leg, the arm comes to rest at each goal where that suits the goal before it. No bound is known for orders
        of such motions. Tours of many goals are not compared.
        """
        few = len(tour.order) <= _FEW
        for order in dict.fromkeys((tour.order, tuple(sorted(tour.order))) if few else ()):
            if deadline.passed():
                break
            visited = replace(tour, order=order).visited
            options = replace(visited.planner, time_limit=deadline.left)
            try:
                found = plan_legs(replace(visited, planner=options), self.planner)
                duration = sum(map(self.time, found))
            except NoPlanFound:
                continue
            if order == tuple(sorted(tour.order)):
                tour = replace(tour, as_given=min(tour.as_given, duration))
            if duration < tour.duration:
                legs, tour = found, replace(tour, order=order, duration=duration, bound=0.0)
        return legs, tour

    def _improved(
        self, legs: Sequence[tuple[int, int]], between: FloatArray, before: IntArray, deadline: Deadline
    ) -> bool:
        """Shorten the ways of legs, or else plan for those by themselves that may gain most; return whether any gained.

        Args:
            legs: pairs of nodes of the legs.
            between: durations of the fastest ways between all nodes, shape (nodes, nodes) [s].
            before: the nodes before the last on these ways, shape (nodes, nodes).
            deadline: time at which all planning has to end.
        """
        pairs = sorted(dict.fromkeys((min(leg), max(leg)) for leg in legs))
        gained = [
            self._shortened(self._way(before, *pair), *pair, float(between[pair]))
            for pair in pairs
            if pair not in self.joined
        ]
        if any(gained):
            return True
        least = self._bounds
        lost = {pair: float(between[pair] - least[pair]) for pair in pairs}
        worth = _WORTH * float(sum(between[leg] for leg in legs))
        for pair in sorted(pairs, key=lambda pair: -lost[pair]):
            late = deadline.left < (1.0 - _PLANNING_SHARE) * self.problem.planner.time_limit
            if pair not in self.planned and lost[pair] > worth and not late:
                gained.append(self._planned(*pair, deadline))
        return any(gained)

    def _leg(self, before: IntArray, one: int, other: int) -> Leg:
        """Return the leg from one node to another on the fastest known way."""
        problem = self._leg_problem(self.rests[one], self.rests[other].stop)
        return Leg(problem, end_to_end(self._way(before, one, other)))

    @property
    def _bounds(self) -> FloatArray:
        """Lower bounds on the durations of motions between nodes from rest to rest, shape (nodes, nodes) [s]."""
        q = np.stack([rest.q for rest in self.rests])
        away = np.abs(q[:, None] - q[None])
        speed, acceleration = self._speed, self._acceleration
        # Of each coordinate by itself, with the greatest rates: to and from its speed limit, or less if it is near.
        fast = away / speed + speed / acceleration
        slow = 2.0 * np.sqrt(away / acceleration)
        return np.asarray(np.max(np.where(away * acceleration > speed**2, fast, slow), axis=2))
