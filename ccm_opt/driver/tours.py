"""Planning of a motion to several goals in the order that takes least time.

A tree of certified motions grows from the start: the goal next to any goal of the tree is planned for from there or, if
that fails, from the start. Where the arm comes to rest, it stays for this goal. Between two goals the arm then moves
along the tree, shortened by certified straight motions (``planning.joining``), and backwards as forwards, since limits
are symmetric.

Which goals follow each other is found lazily. As long as the motion between two goals is unknown, a lower bound on its
duration stands for it: that of moving each coordinate by itself. The best order for these costs is determined
(``tour_order``), its motions are made and timed, and so on until the best order has known motions only. Then no order
of these motions is shorter. A few goals are also planned leg by leg in this order, and in the given one, as goals in
given order are; the fastest motion is taken.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ccm_opt.core.arrays import FloatArray
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
_SLOW = 1.1
"""Duration of a motion above which it is planned for by itself, as a multiple of its lower bound. Heuristic."""
_LONG = 3.0
"""Duration of a joined motion above which the motions that it joins are timed one by one too, as a multiple of its
lower bound. Heuristic."""
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
        number: index of the goal in the problem; −1 for the start.
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
        self._grow(deadline)
        self._refuse_incomplete()
        with self.stages("order"):
            legs, tour = self._ordered(deadline)
        return self._compared(legs, tour, deadline) if len(tour.order) <= _FEW else (legs, tour)

    # ------------------------------------------------------------ the tree
    def _grow(self, deadline: Deadline) -> None:
        """Reach all goals that can be reached, each from the nearest goal that is reached already."""
        goals = self.problem.numbered_goals
        tips = {k: stop.goal.tip(self.problem.arm) for k, stop in enumerate(goals)}
        at = [self.problem.arm.joint_positions_at(self.rests[0].q)[-1]]
        left = set(tips)
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
                path = self.planner.plan(asked)
            except NoPlanFound as failure:
                # The reason from the start is told, from which the goal is planned for last.
                self.failures[number] = failure
                continue
            self.failures.pop(number, None)
            return _Rest(number, stop, np.asarray(path.spline(1.0)), parent, path)
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
        if len(self.rests) > 1 and not must_end:
            return
        number = last if must_end else min(self.failures)
        failure = self.failures[number]
        words = ", at which the motion has to end" if must_end else "; no other goal is reached either"
        found: Diagnosis = failure.diagnosis
        reason = f"goal {number + 1} of {len(goals)}: {found.reason}{words if must_end else ''}"
        if not must_end and len(goals) > 1:
            reason += words
        raise type(failure)(replace(found, reason=reason, evidence={**found.evidence, "goal": number + 1})) from failure

    # ------------------------------------------------------------ legs
    def _chain(self, first: int, second: int) -> list[JointPath]:
        """Return the paths of the tree that lead from one node to another, each in the direction of travel."""
        ways = []
        for node in (first, second):
            way = [node]
            while way[-1] != 0:
                way.append(self.rests[way[-1]].parent)
            ways.append(way)
        shared = set(ways[0]) & set(ways[1])
        back = [self._path(node).reversed() for node in ways[0] if node not in shared]
        return back + [self._path(node) for node in reversed(ways[1]) if node not in shared]

    def _path(self, node: int) -> JointPath:
        path = self.rests[node].path
        assert path is not None  # noqa: S101 - all nodes but the start have one
        return path

    def _made(self, first: int, second: int) -> tuple[JointPath, float]:
        """Return the path between two nodes, the first one with the lower index, and its duration [s]."""
        through = self._chain(first, second)
        rows = np.vstack([part.spline(np.linspace(0.0, 1.0, _SAMPLES * len(part.keyframes) + 1)) for part in through])
        rows[[0, -1]] = self.rests[first].q, self.rests[second].q
        begin = self.rests[first]
        problem = self._leg_problem(begin, self.rests[second].stop)
        # The way from the start to a goal is kept as it was planned, with its clearance.
        joined = None if first == 0 and len(through) == 1 else self._joiner.path(rows)
        best, least = end_to_end(through), _UNTIMED
        for path in [*([] if joined is None else [joined]), best]:
            try:
                duration = self.time(Leg(problem, path))
            except NoPlanFound:
                continue
            if duration < least:
                best, least = path, duration
            if least <= _LONG * self._bounds([first, second])[0, 1]:
                break
        return best, least

    def _planned(self, first: int, second: int, deadline: Deadline) -> tuple[JointPath, float] | None:
        """Return a path between two nodes that is planned by itself, and its duration [s]; None if there is none."""
        end = JointPose.from_configuration(self.rests[second].q, self.problem.arm.coordinates)
        problem = self._leg_problem(self.rests[first], Stop(end, Tolerances()))
        limit = max(_TRY_SHARE * deadline.left, LEAST_TIME)
        try:
            path = self.planner.plan(replace(problem, planner=replace(problem.planner, time_limit=limit)))
            return path, self.time(Leg(problem, path))
        except NoPlanFound:
            return None

    # ------------------------------------------------------------ the order
    def _ordered(self, deadline: Deadline) -> tuple[tuple[Leg, ...], Tour]:
        end = self.problem.planner.end
        count = len(self.rests)
        # The place at which the tour ends comes last.
        last = next((k for k, rest in enumerate(self.rests) if rest.number == len(self.problem.stops)), count - 1)
        nodes = [*(k for k in range(count) if k != last), last] if end == "last" else list(range(count))
        solver = OrderSolver(count, end)
        least = self._bounds(nodes)
        costs = least.copy()
        known = np.eye(count, dtype=bool)
        planned = known.copy()

        def make(order: Sequence[int]) -> None:
            for one, other in map(sorted, tour_legs(order, end)):
                if known[one, other]:
                    continue
                first, second = sorted((nodes[one], nodes[other]))
                self.paths[first, second], duration = self._made(first, second)
                costs[one, other] = costs[other, one] = duration
                known[one, other] = known[other, one] = True

        def improve(order: Sequence[int]) -> bool:
            """Plan for the motions of an order that take much longer than they might, and return whether any gained."""
            pairs = [sorted(pair) for pair in tour_legs(order, end)]
            gained = False
            for one, other in sorted(pairs, key=lambda pair: least[*pair] - costs[*pair]):
                slow = costs[one, other] > _SLOW * least[one, other] and not planned[one, other]
                if not slow or deadline.left < (1.0 - _PLANNING_SHARE) * self.problem.planner.time_limit:
                    continue
                planned[one, other] = True
                first, second = sorted((nodes[one], nodes[other]))
                found = self._planned(first, second, deadline)
                if found is not None and found[1] < costs[one, other]:
                    self.paths[first, second], costs[one, other] = found
                    costs[other, one] = costs[one, other]
                    gained = True
            return gained

        number_of = {self.rests[node].number: k for k, node in enumerate(nodes)}
        as_given = tuple(number_of[number] for number in sorted(number_of) if number >= 0)
        make(as_given)
        improve(as_given)
        while True:
            found = solver.solve(costs, deadline)
            before = int(known.sum())
            make(found.places)
            if deadline.passed() or (known.sum() == before and not improve(found.places)):
                break
        best = min(found.places, as_given, key=lambda order: tour_cost(costs, order, end))
        duration = tour_cost(costs, best, end)
        tour = Tour(
            self.problem,
            tuple(self.rests[nodes[k]].number + 1 for k in best),
            tuple(
                UnvisitedGoal(number + 1, failure.status, failure.diagnosis.reason)
                for number, failure in sorted(self.failures.items())
            ),
            duration=duration,
            bound=min(found.bound, duration),
            as_given=tour_cost(costs, as_given, end),
        )
        return tuple(self._leg(nodes[one], nodes[other]) for one, other in tour_legs(best, end)), tour

    # ------------------------------------------------------------ leg by leg
    def _compared(self, legs: tuple[Leg, ...], tour: Tour, deadline: Deadline) -> tuple[tuple[Leg, ...], Tour]:
        """Return the fastest of a tour, of the same order planned leg by leg, and of the given order likewise.

        Leg by leg, the arm comes to rest at each goal where that suits the goal before it. No bound is known for orders
        of such motions.
        """
        for order in dict.fromkeys((tour.order, tuple(sorted(tour.order)))):
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

    def _leg(self, one: int, other: int) -> Leg:
        path = self.paths[min(one, other), max(one, other)]
        problem = self._leg_problem(self.rests[one], self.rests[other].stop)
        return Leg(problem, path if one < other else path.reversed())

    def _bounds(self, nodes: Sequence[int]) -> FloatArray:
        """Return lower bounds on the durations of motions between nodes from rest to rest, shape (nodes, nodes) [s]."""
        q = np.stack([self.rests[node].q for node in nodes])
        away = np.abs(q[:, None] - q[None])
        speed, acceleration = self._speed, self._acceleration
        # Of each coordinate by itself, with the greatest rates: to and from its speed limit, or less if it is near.
        fast = away / speed + speed / acceleration
        slow = 2.0 * np.sqrt(away / acceleration)
        return np.asarray(np.max(np.where(away * acceleration > speed**2, fast, slow), axis=2))
