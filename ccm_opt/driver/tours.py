"""Planning of a motion to several goals in the order that takes least time.

A tree of certified motions grows from the start: the goal next to any goal of the tree is planned for from there or, if
that fails, from the start. Where the arm comes to rest, it stays for this goal. Neighbours are also joined by straight
motions where these have a certificate. Between two goals the arm moves along known motions (``known_motions``),
shortened by certified straight ones (``planning.joining``).

The best order for the durations of the fastest ways is determined (``tour_order``), where those that change from one
known motion to another count as estimated until they are tried. Its ways are shortened to motions of their own, slow
ones are planned for by themselves, and so on until nothing changes. Then no order of the motions
found is faster. The bound that is told is that of all orders in which, between goals without a known motion, each
coordinate moves by itself.

Legs that lack clearance which their ends have are planned for by themselves. A few goals are also planned leg by leg in
this order, and in the given one, as goals in given order are: the arm then rests where it has room. The fastest motion
is taken, where one that keeps none of the preferred clearance counts as twice as long.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.core.deadline import Deadline
from ccm_opt.core.errors import Diagnosis, NoPlanFound, UnreachableGoal
from ccm_opt.core.progress import Stages
from ccm_opt.driver.known_motions import KnownMotions, Rest
from ccm_opt.driver.legs import LEAST_TIME, Leg, Planner, plan_legs
from ccm_opt.driver.tour_order import OrderSolver, tour_cost, tour_legs
from ccm_opt.problem import JointPose, Problem, Stop, Tolerances
from ccm_opt.problem.poses import name_suffix
from ccm_opt.problem.solution import JointPath, Tour, UnvisitedGoal

_TIME_SHARE = 3.0
"""Time that a goal may take, as a multiple of an equal share of what is left. Heuristic: most goals take less."""
_OTHER_STARTS = 2
"""Number of goals of the tree from which a goal is planned for again that was not reached at first. Heuristic."""
_WORTH = 0.01
"""Time that a motion has to lose against its lower bound to be planned for by itself, as a fraction of the duration of
the tour. Heuristic."""
_PLANNING_SHARE = 0.75
"""Fraction of the time limit until which motions are planned for by themselves. Heuristic."""
_LINKING_SHARE = 0.5
"""Fraction of the time left in which ways over the roadmap of known motions are tried. Heuristic: thirty views in a
blade row take half of it."""
_FEW = 12
"""Number of goals up to which the order found, and the given one, are planned leg by leg as well. Heuristic."""


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
        failures: errors of the goals that were not reached, by index.
        poses: known configurations at goals, by index of the goal, each of shape (c,).
    """

    problem: Problem
    planner: Planner
    time: Callable[[Leg], float]
    refuse: Callable[[Problem], None]
    stages: Stages
    share: float
    failures: dict[int, NoPlanFound] = field(default_factory=dict)
    poses: dict[int, FloatArray] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.motions = KnownMotions(self.problem, self.planner, self.time, self.share)

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
        self.motions.problem, rests = problem, self.motions.rests
        rests[1:] = [replace(rest, number=number_of.get(id(rest.stop.goal), -1)) for rest in rests[1:]]
        return self._toured(Deadline.after(problem.planner.time_limit))

    # ------------------------------------------------------------ the tree
    def _grow(self, deadline: Deadline) -> None:
        """Reach all goals that can be reached, each from the nearest goal that is reached already."""
        goals = self.problem.numbered_goals
        tips = {k: stop.goal.tip(self.problem.arm) for k, stop in enumerate(goals)}
        at = [self.problem.arm.joint_positions_at(self.motions.rests[0].q)[-1]]
        at += [rest.stop.goal.tip(self.problem.arm) for rest in self.motions.rests[1:]]
        left = set(tips) - {rest.number for rest in self.motions.rests}
        while left:
            # The nearest goal and where it is reached from; equal distances are decided by place, not by number.
            away = {k: [float(np.linalg.norm(tips[k] - tip)) for tip in at] for k in left}
            k = min(left, key=lambda k: (min(away[k]), *tips[k].tolist(), k))
            left.discard(k)
            parent = int(np.argmin(away[k]))
            rest = self._reached(k, goals[k], dict.fromkeys((parent, 0)), deadline, len(left))
            if rest is not None:
                self.motions.rests.append(rest)
                at.append(tips[k])
        for k in sorted(self.failures, key=lambda k: tips[k].tolist()):
            if isinstance(self.failures[k], UnreachableGoal) or deadline.passed():
                continue
            near = (
                np.argsort([float(np.linalg.norm(tips[k] - tip)) for tip in at[1:]], kind="stable")[:_OTHER_STARTS] + 1
            )
            rest = self._reached(k, goals[k], [int(parent) for parent in near], deadline, len(self.failures))
            if rest is not None:
                self.motions.rests.append(rest)
                at.append(tips[k])
                del self.failures[k]

    def _reached(
        self, number: int, stop: Stop, parents: Sequence[int] | dict[int, None], deadline: Deadline, later: int
    ) -> Rest | None:
        """Return the pose in which the arm rests at a goal, with the motion to it; None if there is none.

        Args:
            number: index of the goal in the problem.
            stop: the goal.
            parents: nodes of the tree from which it is planned for, in this order.
            deadline: time at which all planning has to end.
            later: number of goals that are still to be reached.
        """
        self.stages.tell(candidate=f"goal {number + 1}{name_suffix(stop.goal)}")
        try:
            self.refuse(self.motions.leg_problem(self.motions.rests[0], stop))
        except UnreachableGoal as proved:
            self.failures[number] = proved
            return None
        for parent in parents:
            begin = self.motions.rests[parent]
            limit = max(_TIME_SHARE * deadline.left / (later + _TIME_SHARE), LEAST_TIME)
            # Motions between goals are shortened later; that to the first goal is optimised.
            optimiser = self.problem.planner.optimiser if parent == 0 else "none"
            asked = self.motions.leg_problem(begin, stop)
            asked = replace(asked, planner=replace(asked.planner, time_limit=limit, optimiser=optimiser))
            try:
                path = self._path_to_pose(asked, number) or self.planner.plan(asked)
            except NoPlanFound as failure:
                # The reason from the start is told, from which the goal is planned for last.
                self.failures[number] = failure
                continue
            self.failures.pop(number, None)
            return Rest(number, stop, np.asarray(path.spline(1.0)), parent, path)
        return None

    def _path_to_pose(self, asked: Problem, number: int) -> JointPath | None:
        """Return a path to the known pose at a goal; None if there is none, or no path is found in half the time."""
        q = self.poses.get(number)
        if q is None:
            return None
        known = self.motions.along_chain(asked.start.configuration(asked.arm), q)
        if known is not None:
            return known
        pose = JointPose.from_configuration(q, asked.arm.coordinates)
        options = replace(asked.planner, time_limit=0.5 * asked.planner.time_limit)
        try:
            return self.planner.plan(replace(asked, goal=pose, tolerances=Tolerances(), planner=options))
        except NoPlanFound:
            return None

    def _refuse_incomplete(self) -> None:
        goals = self.problem.numbered_goals
        last = len(goals) - 1
        must_end = self.problem.planner.end == "last" and last in self.failures
        if any(rest.number >= 0 for rest in self.motions.rests) and not must_end:
            return
        number = last if must_end else min(self.failures)
        failure = self.failures[number]
        words = ", at which the motion has to end" if must_end else "; no other goal is reached either"
        found: Diagnosis = failure.diagnosis
        title = f"goal {number + 1} of {len(goals)}{name_suffix(goals[number].goal)}"
        reason = f"{title}: {found.reason}{words if must_end else ''}"
        if not must_end and len(goals) > 1:
            reason += words
        raise type(failure)(replace(found, reason=reason, evidence={**found.evidence, "goal": number + 1})) from failure

    # ------------------------------------------------------------ the order
    def _ordered(self, deadline: Deadline) -> tuple[tuple[Leg, ...], Tour]:
        end = self.problem.planner.end
        # The place at which the tour ends comes last.
        nodes = [0, *(k for k, rest in enumerate(self.motions.rests) if rest.number >= 0)]
        nodes.sort(key=lambda k: end == "last" and self.motions.rests[k].number == len(self.problem.stops))
        places = np.ix_(nodes, nodes)
        solver = OrderSolver(len(nodes), end)
        self.motions.join_neighbours()
        self.motions.make_roadmap()
        linking = deadline.within(_LINKING_SHARE * deadline.left)
        while True:
            between, before = self.motions.fastest()
            costs = between if linking.passed() else self.motions.estimated(between)
            found = solver.solve(costs[places], deadline)
            legs = [(nodes[one], nodes[other]) for one, other in tour_legs(found.places, end)]
            faster = [(min(leg), max(leg)) for leg in legs if costs[leg] < between[leg]]
            for pair in dict.fromkeys(faster):
                self.motions.link(*pair)
            if faster:
                continue
            duration = float(sum(between[leg] for leg in legs))
            if deadline.passed():
                break
            if not self._improved(legs, between, before, deadline) and not self._explored(
                solver, nodes, between, duration, deadline
            ):
                break
        number_of = {self.motions.rests[node].number: k for k, node in enumerate(nodes)}
        as_given = tuple(number_of[number] for number in sorted(number_of) if number >= 0)
        known = np.eye(len(self.motions.rests), dtype=bool)
        for pair in self.motions.paths:
            known[pair] = known[pair[::-1]] = True
        bound = solver.solve(np.where(known, between, self.motions.bounds)[places], deadline).bound
        tour = Tour(
            self.problem,
            tuple(self.motions.rests[nodes[k]].number + 1 for k in found.places),
            tuple(
                UnvisitedGoal(number + 1, failure.status, failure.diagnosis.reason)
                for number, failure in sorted(self.failures.items())
            ),
            duration=duration,
            bound=min(bound, duration),
            as_given=tour_cost(between[places], as_given, end),
        )
        return tuple(self.motions.leg(before, *leg) for leg in legs), tour

    # ------------------------------------------------------------ leg by leg
    def compared(self, legs: tuple[Leg, ...], tour: Tour, deadline: Deadline) -> tuple[tuple[Leg, ...], Tour]:
        """Return the best of a tour, of the same order planned leg by leg, and of the given order likewise.

        Legs of the tour that lack clearance on the way are planned by themselves.

        Leg by leg, the arm comes to rest at each goal where that suits the goal before it. No bound is known for orders
        of such motions. Tours of many goals are not compared.
        """
        improved = tuple(self.motions.with_more_clearance(leg, deadline) for leg in legs)
        if any(new is not old for new, old in zip(improved, legs, strict=True)):
            legs, tour = improved, tour.lasting(sum(map(self.time, improved)))
        few = len(tour.order) <= _FEW
        least = self.motions.cost(legs, tour.duration) if few else 0.0
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
            cost = self.motions.cost(found, duration)
            if cost < least:
                least, legs, tour = cost, found, replace(tour, order=order, bound=0.0).lasting(duration)
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
            self.motions.shorten(self.motions.way(before, *pair), *pair, float(between[pair]))
            for pair in pairs
            if pair not in self.motions.joined
        ]
        if any(gained):
            return True
        least = self.motions.bounds
        lost = {pair: float(between[pair] - least[pair]) for pair in pairs}
        worth = _WORTH * float(sum(between[leg] for leg in legs))
        slow = [pair for pair in sorted(pairs, key=lambda pair: -lost[pair]) if lost[pair] > worth]
        return self._planned(slow, deadline)

    def _explored(
        self, solver: OrderSolver, nodes: Sequence[int], between: FloatArray, duration: float, deadline: Deadline
    ) -> bool:
        """Plan for motions between few goals that a faster order may have, and return whether any gained.

        The best order is determined as if motions that were not planned for took as long as their lower bounds, and
        those in it are planned for, until no such order is faster.

        Args:
            solver: solver of the order.
            nodes: the nodes that are visited, in the solver's order of places.
            between: durations of the fastest ways between all nodes, shape (nodes, nodes) [s].
            duration: duration of the best order so far [s].
            deadline: time at which all planning has to end.
        """
        if len(nodes) > _FEW + 1:
            return False
        end = self.problem.planner.end
        least = self.motions.bounds
        open_pairs = between - least > _WORTH * duration / len(nodes)
        while not self._late(deadline):
            for pair in self.motions.planned:
                open_pairs[pair] = open_pairs[pair[::-1]] = False
            costs = np.where(open_pairs, least, between)
            found = solver.solve(costs[np.ix_(nodes, nodes)], deadline)
            legs = [(nodes[one], nodes[other]) for one, other in tour_legs(found.places, end)]
            new = [(min(leg), max(leg)) for leg in legs if open_pairs[leg]]
            if not new or sum(costs[leg] for leg in legs) > (1.0 - _WORTH) * duration:
                return False
            if self._planned(new, deadline):
                return True
        return False

    def _planned(self, pairs: Sequence[tuple[int, int]], deadline: Deadline) -> bool:
        """Plan by themselves for motions between pairs of nodes that were not, and return whether any gained time."""
        gained = False
        for pair in pairs:
            if pair not in self.motions.planned and not self._late(deadline):
                gained = self.motions.plan(*pair, deadline) or gained
        return gained

    def _late(self, deadline: Deadline) -> bool:
        """Return whether the time is over until which motions are planned for by themselves."""
        return deadline.left < (1.0 - _PLANNING_SHARE) * self.problem.planner.time_limit
