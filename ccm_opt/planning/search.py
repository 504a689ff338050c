"""Search for a motion by one strategy after another, and the diagnosis if none is found.

The outcome of every candidate is recorded; the diagnosis says where the best one ended and which obstruction was
nearest.
"""

from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from math import inf
from typing import Any, Generic, TypeVar

import numpy as np
from scipy.interpolate import BSpline

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.core.deadline import Deadline
from ccm_opt.core.errors import Diagnosis, MotionNotFound, TimeLimitReached
from ccm_opt.core.length_words import short_length
from ccm_opt.core.progress import report_candidate
from ccm_opt.planning.goal import GoalPose
from ccm_opt.planning.limits.limit import LimitOf
from ccm_opt.planning.limits.motion_certificate import MotionCertificate, failing_edges
from ccm_opt.planning.limits.user_limit import UserLimit
from ccm_opt.planning.motion import CurveMotion
from ccm_opt.planning.optimisation.sequential_convex import MotionProgram
from ccm_opt.planning.settings import EngineSettings
from ccm_opt.planning.step import StepperOf
from ccm_opt.planning.via_places import passings
from ccm_opt.problem import OptimiserName, Weights
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.configuration import Configuration
from ccm_opt.scene.bad_pose import joints_at_limits
from ccm_opt.scene.contact_finder import ContactFinder, describe_clearance


@dataclass(frozen=True)
class Failure:
    """Record of a failed candidate of the search.

    Attributes:
        candidate: name of the candidate.
        message: description of how far the candidate came.
        remaining: distance from the goal of the tip or, with a goal for the whole arm, of the farthest joint [m].
        tightest: name of a link, name of the nearest obstruction, and the gap between them [m]; None if nothing is
            near.
        pose: configuration in which the candidate ended, shape (c,) [rad, m].
        bends: bends of the joints in that configuration, k per joint, shape (links, k) [rad].
        limit: name of the user's constraint that stopped the candidate, or empty.
    """

    candidate: str
    message: str
    remaining: float
    tightest: tuple[str, str, float] | None
    pose: FloatArray
    bends: FloatArray
    limit: str = ""

    @property
    def obstacle(self) -> str:
        """Message about the link and the obstruction with the least gap."""
        if self.tightest is None:
            return "nothing near"
        return describe_clearance(*self.tightest)


def clearance_cost(duration: float, lack: float) -> float:
    """Return the cost of a motion: its duration [s], doubled if the motion keeps none of the preferred clearance.

    Args:
        duration: the duration [s].
        lack: how much of the preferred clearance the motion lacks at worst, as a fraction of it.
    """
    return duration * (1.0 + min(max(lack, 0.0), 1.0))


def report_tried(candidate: str, failures: Sequence[Failure]) -> None:
    """Report to progress listeners the candidate now tried, its number and the least distance from the goal so far."""
    report_candidate(len(failures) + 1, candidate, min((failure.remaining for failure in failures), default=inf))


@dataclass(frozen=True)
class StrategyInVain:
    """Record of a search strategy that found no motion, or was never begun.

    Attributes:
        name: name of the strategy.
        attempts: number of its attempts, all of which failed.
        exhausted: whether all its candidates were tried; otherwise the deadline passed first.
    """

    name: str
    attempts: int
    exhausted: bool


@dataclass(frozen=True, eq=False, kw_only=True)
class SearchTask(ABC):
    """Inputs of a search for a motion, in the plane or in space.

    Attributes:
        arm: the arm.
        start: configuration at the start, shape (c,) [rad, m].
        goal: goal of the tip.
        goal_pose: goal configuration of the whole arm, shape (c,); None if only the tip counts.
        via: via points, which the tip has to pass in this order, each of shape (d,) [m].
        deadline: time at which the search stops.
        optimiser: name of the method that optimises a found motion.
        weights: weights of the costs of the optimisation.
        wanted_gap: gap beyond radius and clearance that the motion keeps where possible [m].
        seed: seed of the random numbers.
        refuse: function that raises an error if it proves that there is no motion; called once, before costly
            strategies.
        user: the user's constraints and costs; None without any.
        held: limits of the motion besides contact, joints, turns and the user's; in the plane a guide tube.
        settings: settings of every stage of the search.
    """

    arm: Arm
    start: FloatArray
    goal: GoalPose
    goal_pose: FloatArray | None = None
    via: tuple[FloatArray, ...] = ()
    deadline: Deadline
    optimiser: OptimiserName = "sequential-convex"
    weights: Weights = field(default_factory=Weights)
    wanted_gap: float = 0.0
    seed: int = 0
    refuse: Callable[[], None] = field(default=lambda: None)
    user: UserLimit | None = None
    held: tuple[LimitOf[Any], ...] = ()
    settings: EngineSettings = field(default_factory=EngineSettings)

    @property
    def user_limits(self) -> tuple[UserLimit, ...]:
        """Limit with the user's constraints and costs, as a tuple of at most one element."""
        return () if self.user is None else (self.user,)

    @property
    @abstractmethod
    def kept(self) -> float:
        """Required distance of walls from the arm's centre line: radius plus clearance [m]."""

    @property
    @abstractmethod
    def advice(self) -> str:
        """Advice to the user if no motion is found and nothing more specific is known."""

    @property
    @abstractmethod
    def certificate(self) -> MotionCertificate:
        """Certificate of contact and all other limits, which every motion must pass."""

    @abstractmethod
    def finder(self, margin: float, reach: float) -> ContactFinder:
        """Return a finder of contacts with a planning margin and a search distance [m]."""

    @abstractmethod
    def program(self, motion: CurveMotion[Any], margin: float | None = None) -> MotionProgram[Any]:
        """Return the optimisation problem for a motion: limits, goal and weights, without its keyframes.

        Args:
            motion: certified motion.
            margin: gap beyond contact that constraints require, as a fraction of the arm's length; the default if None.
        """

    def certificate_with(self, gap: float) -> MotionCertificate:
        """Return a certificate that requires at least a gap beyond contact [m]; the base class ignores the gap."""
        del gap
        return self.certificate

    def failures(self, curve: Any, unknowns: FloatArray, depth: int | None = None, gap: float = -np.inf) -> IntArray:
        """Return the sorted indices of the intervals of a motion that cannot be certified.

        Args:
            curve: map from the unknowns to configurations.
            unknowns: unknowns at the keyframes, shape (K, p).
            depth: allowed number of bisections per interval; that of the settings if None.
            gap: gap beyond contact to certify, if larger than the usual one [m].
        """
        certificate = self.certificate if gap == -np.inf else self.certificate_with(gap)
        return failing_edges(certificate.limits, curve, unknowns, depth)

    @abstractmethod
    def stepper(self, curve: Any, margin: float) -> StepperOf[Any]:
        """Return a solver of QP steps in the unknowns of a curve, with a planning margin."""

    def marks(self, motion: CurveMotion[Any]) -> FloatArray:
        """Return the positions along a motion, as fractional keyframe indices, that must be keyframes, shape (m,).

        They are those where a constraint begins or ends, and where the tip passes via points.
        """
        breaks = [] if motion.u is None else [u for limit in self.user_limits for u in limit.breaks]
        marks = np.interp(breaks, motion.path_parameters, np.arange(len(motion.unknowns)))
        if not self.via:
            return marks
        # These include the positions where the tip comes nearest to its via points.
        tips = self.arm.joint_positions_at(motion.curve.configurations(motion.unknowns))[:, -1]
        return np.union1d(marks, passings(tips, np.stack(self.via)).along)

    @abstractmethod
    def free(self, q: FloatArray) -> FloatArray:
        """Return 1.0 for each coordinate of a configuration (c,) that may change, 0.0 for the others, shape (c,)."""

    @abstractmethod
    def clearance_shortfall(self, q: FloatArray) -> FloatArray:
        """Return how much of the preferred clearance each configuration (k, c) lacks, at least 0, shape (k,) [m]."""

    def shortfall_on_the_way(self, q: FloatArray) -> float:
        """Return how much more of the preferred clearance a motion (K, c) lacks than its worse end, at least 0 [m]."""
        shortfall = self.clearance_shortfall(q)
        return float(np.max(shortfall) - np.max(shortfall[[0, -1]]))

    def least_gap(self, q: FloatArray) -> float:
        """Return the least gap beyond contact over configurations (K, c), capped at the preferred clearance [m]."""
        return float(self.wanted_gap - np.max(self.clearance_shortfall(q)))

    @abstractmethod
    def keyframes_along(
        self, keyframes: FloatArray, spline: BSpline, *, legs: bool
    ) -> tuple[FloatArray, BSpline, tuple[Configuration, ...]]:
        """Return the keyframes (K, c) and joint path of a plan, and the continuous curves at the keyframes, if any.

        Args:
            keyframes: configurations at the keyframes of a motion, shape (K, c).
            spline: joint path near the keyframes.
            legs: whether the arm will move on straight legs between the keyframes.
        """

    def violated_place(self, spline: BSpline) -> Diagnosis | None:
        """Return the diagnosis of a joint path that violates a requirement which is no limit (via points), or None."""
        del spline
        return None

    @property
    def constraints(self) -> tuple[str, ...]:
        """Names of the user's hard constraints."""
        return tuple(name for limit in self.user_limits for name in limit.names)

    @property
    def parametric(self) -> bool:
        """Whether a limit depends on the path parameter, so that a motion has to be tracked under the limit."""
        return any(limit.parametric for limit in self.user_limits)

    @property
    def limited_goal(self) -> GoalPose:
        """Goal of the tip together with the limits that apply at the end of the motion."""
        return self.limited(self.goal)

    def limited(self, goal: GoalPose) -> GoalPose:
        """Return a copy of a goal to which the limits that apply at the end of the motion are added."""
        limits = tuple(limit.placed_at_goal() for limit in self.user_limits)
        return replace(goal, limits=limits, settings=self.settings.goal)


AskedType = TypeVar("AskedType")
"""Type of a strategy's input: a search task, or a run of a search."""
FoundType = TypeVar("FoundType")
"""Type of a strategy's result."""


@dataclass(frozen=True)
class Strategy(Generic[AskedType, FoundType]):
    """Method of searching for a motion.

    Attributes:
        name: name in the record of a failed search.
        find: function that returns a certified motion, or None after appending its attempts to the failures.
        applies: function that returns whether the strategy can find motions for a task.
        costly: whether the strategy may take so long that a proof of infeasibility, which takes a few tenths of a
            second, is tried first.
        leads_others: whether later strategies begin with the candidates of this one, so that it is not repeated with
            the arm's own links after a failure with few links.
    """

    name: str
    find: Callable[[AskedType, list[Failure]], FoundType | None]
    applies: Callable[[AskedType], bool] = lambda _: True
    costly: bool = False
    leads_others: bool = False


StrategyType = TypeVar("StrategyType", bound=Strategy[Any, Any])
"""Type of the strategies of a search."""


def first_found(
    strategies: Iterable[StrategyType],
    task: SearchTask,
    find: Callable[[StrategyType, list[Failure]], FoundType | None],
) -> FoundType:
    """Return the result of the first search strategy that succeeds.

    Args:
        strategies: strategies that apply, cheap ones first; those after the deadline are only recorded.
        task: search task.
        find: function that runs a strategy and appends its failed attempts to the failures.

    Raises:
        MotionNotFound: every strategy failed; the diagnosis lists why.
        TimeLimitReached: the deadline passed first.
        UnreachableGoal: it is proved that there is no motion.
    """
    failures: list[Failure] = []
    in_vain: list[StrategyInVain] = []
    asked = False
    for strategy in strategies:
        before = len(failures)
        if not failures or not task.deadline.passed():
            if strategy.costly and not asked:
                task.refuse()
                asked = True
            found = find(strategy, failures)
            if found is not None:
                return found
        in_vain.append(StrategyInVain(strategy.name, len(failures) - before, not task.deadline.passed()))
    raise nothing_found(task, failures, in_vain)


def nothing_found(
    task: SearchTask, failures: Sequence[Failure], strategies: Sequence[StrategyInVain]
) -> MotionNotFound | TimeLimitReached:
    """Return the error with a diagnosis of why no motion was found.

    Args:
        task: search task.
        failures: failures of all attempts.
        strategies: records of all strategies, in order.
    """
    tried = sorted(failures, key=lambda f: f.remaining)
    held: tuple[str, ...] = ()
    if tried:
        best = tried[0]
        what = "the tip" if task.goal_pose is None else "a joint"
        candidates = f"{len(tried)} candidate{'s' * (len(tried) != 1)}"
        reason = (
            f"no motion found in {candidates}; the best ({best.candidate}) ended with {what} "
            f"{short_length(best.remaining)} from the goal: {best.message}; nearest there: {best.obstacle}"
        )
        joints, held = joints_at_limits(task.arm, best.bends)
        reason += f"; {joints}" if joints else ""
    else:
        reason = "no motion found: no route to the goal was found that is wide and short enough for the arm"
    reason += _limits_in_the_way(task.constraints, tried)
    reason += _how_far(strategies)
    figures = {**evidence(tried), "strategies": [asdict(each) for each in strategies]}
    relaxed = ("relax the constraints, or make them soft (not tried)",) if task.constraints else ()
    met = (*relaxed, *held, *_widened(task, tried))
    left = sum(not each.exhausted for each in strategies)
    if left:
        reason = f"{task.deadline.what_passed()}: {reason}"
        more = f"raise planner.time_limit: {left} of {len(strategies)} strategies were cut short or not begun"
        return TimeLimitReached(Diagnosis(reason, "motion", (more, *met), figures))
    # No parameter of the arm is advised without evidence: what is missing may be luck.
    advice = ("try other seeds: planner.seed, or planner.tries for several (not tried)", *met, task.advice)
    return MotionNotFound(Diagnosis(reason, "motion", advice, figures))


_CLOSE = 0.1
"""Gap below which a wall may have stopped an attempt, as a fraction of the distance that walls have to keep from the
arm's centre line. Heuristic."""


def _widened(task: SearchTask, tried: Sequence[Failure]) -> tuple[str, ...]:
    """Return advice to widen the passage if the best attempt ended close to a wall, else an empty tuple."""
    if not tried or tried[0].tightest is None:
        return ()
    link, name, gap = tried[0].tightest
    if not name.startswith("'") or gap > _CLOSE * task.kept:
        return ()
    thinner = f" or reduce {task.arm.key('radius')}" if task.arm.radius > 0.0 and link.startswith("link") else ""
    where = f"{link} had a clearance of {short_length(gap)} to it where the best attempt ended"
    return (f"widen the passage at {name}{thinner} (not tried): {where}",)


def _how_far(strategies: Sequence[StrategyInVain]) -> str:
    """Return a message that says which strategies were exhausted, which ran out of time, and which were not begun."""
    # A strategy that was exhausted without an attempt says nothing about the problem.
    tried = [each for each in strategies if each.attempts]
    parts = {
        "exhausted": _attempts(each for each in tried if each.exhausted),
        "cut short": _attempts(each for each in tried if not each.exhausted),
        "not begun": list(dict.fromkeys(each.name for each in strategies if not each.attempts and not each.exhausted)),
    }
    return "".join(f"; {what}: {', '.join(names)}" for what, names in parts.items() if names)


def _attempts(strategies: Iterable[StrategyInVain]) -> list[str]:
    """Return the names of strategies, each once, with the number of attempts of all rounds."""
    counts: dict[str, int] = {}
    for each in strategies:
        counts[each.name] = counts.get(each.name, 0) + each.attempts
    return [f"{name} ({count} attempt{'s' * (count != 1)})" for name, count in counts.items()]


def evidence(tried: Sequence[Failure]) -> Mapping[str, object]:
    """Return the JSON-serialisable data behind the diagnosis of a failed search.

    Args:
        tried: failures, sorted by their distance from the goal.

    Returns:
        ``tried``: a line for each failure; ``candidates``: a table for each; ``in_the_way``: how often each obstruction
        had the least gap; ``nearest_pose``: the configuration in which the best candidate ended.
    """
    named = Counter(f.tightest[1] for f in tried if f.tightest is not None)
    return {
        "tried": [f"{f.candidate}: {f.message} ({f.obstacle})" for f in tried],
        "candidates": [_table(f) for f in tried],
        "in_the_way": dict(named.most_common()),
        "nearest_pose": tried[0].pose.tolist() if tried else [],
    }


def _table(failure: Failure) -> dict[str, object]:
    table: dict[str, object] = {
        "name": failure.candidate,
        "ended": failure.message,
        "remaining": failure.remaining,
        "constraint": failure.limit,
    }
    if failure.tightest is None:
        return table
    link, other, gap = failure.tightest
    return table | {"link": link, "near": other, "gap": gap}


def _limits_in_the_way(names: Sequence[str], tried: list[Failure]) -> str:
    """Return a message that names the user's constraint at which the best of all constrained candidates ended.

    If no candidate ended at a constraint, the message lists all constraints; it is empty if there are none.

    Args:
        names: names of the user's hard constraints.
        tried: failures, sorted by their distance from the goal.
    """
    if not names:
        return ""
    met = [failure.limit for failure in tried if failure.limit]
    if met:
        return f"; {met[0]} where the best such candidate ended ({len(met)} of {len(tried)} ended at a constraint)"
    return "; constraints that had to hold: " + ", ".join(f"'{name}'" for name in names)
