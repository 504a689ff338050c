"""The search for a motion: one attempt after the other, and why there is none.

What every candidate ended at is kept, and said in words with what stood in the way of the best.
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
from ccm_opt.core.progress import tell_candidate
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
from ccm_opt.scene.bad_pose import joints_at_limits, room_advice
from ccm_opt.scene.contact_finder import ContactFinder

TREES = "trees"
"""Name of what trees find, among the names of candidates."""


@dataclass(frozen=True)
class Failure:
    """Why one candidate failed.

    Attributes:
        candidate: its name.
        message: how far it came.
        remaining: distance of the tip, or with a goal for the whole arm of the farthest joint, from the goal [m].
        tightest: link, counted from 1, name of what it nearly touches, and the gap [m]; None when nothing is near.
        pose: where it ended, shape (c,) [rad, and what carries the base].
        bends: of the joints there, k a joint, shape (links, k) [rad].
        limit: what of the user's constraints is in the way, in words, or empty.
    """

    candidate: str
    message: str
    remaining: float
    tightest: tuple[int, str, float] | None
    pose: FloatArray
    bends: FloatArray
    limit: str = ""

    @property
    def obstacle(self) -> str:
        """The tightest contact, in words."""
        if self.tightest is None:
            return "nothing near"
        link, other, gap = self.tightest
        return f"link {link} and {other}, gap {short_length(gap)}"


def tell_tried(candidate: str, failures: Sequence[Failure]) -> None:
    """Tell who listens that a candidate is tried, its number, and how near the best of those before came."""
    tell_candidate(len(failures) + 1, candidate, min((failure.remaining for failure in failures), default=inf))


@dataclass(frozen=True)
class StrategyInVain:
    """How far a strategy was tried that found nothing.

    Attributes:
        name: of the strategy.
        attempts: that it made, each of which failed.
        exhausted: whether all was tried that it has; else the time passed first.
    """

    name: str
    attempts: int
    exhausted: bool


@dataclass(frozen=True, eq=False, kw_only=True)
class SearchTask(ABC):
    """What every search for a motion needs to know.

    Attributes:
        arm: the arm.
        start: where the motion begins, shape (c,).
        goal: where the tip has to be.
        goal_pose: where the whole arm has to be, shape (c,); None where the tip alone counts.
        via: places that the tip passes in this order, each of shape (d,) [m].
        deadline: when to stop.
        optimiser: how the motion that is found is optimised.
        weights: what counts how much then.
        wanted_gap: room beyond radius and clearance that the motion keeps where there is so much [m].
        seed: of the random numbers.
        refuse: raises where it is proved that there is no motion; asked once, before what takes long.
        user: the user's constraints and costs; None where there are none.
        held: limits of the motion beside contact, joints, turns and what the user asks; in the plane a guide tube.
        settings: numbers of every stage of the search.
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
        """What the user asks of the motion; usually nothing."""
        return () if self.user is None else (self.user,)

    @property
    @abstractmethod
    def kept(self) -> float:
        """Distance from the arm's axis that walls have to keep [m]."""

    @property
    @abstractmethod
    def advice(self) -> str:
        """What may help where nothing better is known."""

    @property
    @abstractmethod
    def certificate(self) -> MotionCertificate:
        """Of motions, and of paths between their samples."""

    @abstractmethod
    def finder(self, margin: float, reach: float) -> ContactFinder:
        """Return a finder of contacts with a planning margin and a reach [m]."""

    @abstractmethod
    def program(self, motion: CurveMotion[Any], margin: float | None = None) -> MotionProgram[Any]:
        """Return the program of optimising a motion, its keyframes still to be chosen.

        Args:
            motion: certified.
            margin: gap that rows ask for beyond contact, as a share of the arm's length; the usual one when None.
        """

    def certificate_with(self, gap: float) -> MotionCertificate:
        """The certificate of motions, with more gap beyond contact than they must have where that is told apart [m]."""
        del gap
        return self.certificate

    def failures(self, curve: Any, unknowns: FloatArray, depth: int | None = None, gap: float = -np.inf) -> IntArray:
        """Return the intervals of a motion that cannot be certified, sorted.

        Args:
            curve: the map of the unknowns.
            unknowns: at the keyframes, shape (K, p).
            depth: bisections of an interval that are allowed; as many as the settings say when None.
            gap: beyond contact that is asked for, where that is more than anyway [m].
        """
        certificate = self.certificate if gap == -np.inf else self.certificate_with(gap)
        return failing_edges(certificate.limits, curve, unknowns, depth)

    @abstractmethod
    def stepper(self, curve: Any, margin: float) -> StepperOf[Any]:
        """Return the takes steps in the unknowns of a curve, with a planning margin."""

    def marks(self, motion: CurveMotion[Any]) -> FloatArray:
        """Return where along a motion, counted in keyframes, there have to be some, shape (m,)."""
        breaks = [] if motion.u is None else [u for limit in self.user_limits for u in limit.breaks]
        marks = np.interp(breaks, motion.path_parameters, np.arange(len(motion.unknowns)))
        if not self.via:
            return marks
        # Among them where the tip comes nearest to the places that it passes.
        tips = self.arm.joint_positions_at(motion.curve.configurations(motion.unknowns))[:, -1]
        return np.union1d(marks, passings(tips, np.stack(self.via)).along)

    @abstractmethod
    def free(self, q: FloatArray) -> FloatArray:
        """Return the 1 for what a knot of a path may move about a configuration, 0 for the rest, both of shape (c,)."""

    @abstractmethod
    def room_lacking(self, q: FloatArray) -> FloatArray:
        """Return by how much configurations, shape (k, c), lack the wanted room, shape (k,) [m]."""

    def least_gap(self, q: FloatArray) -> float:
        """Return the least gap beyond contact of configurations, shape (K, c) [m], as far as the wanted gap sees."""
        return float(self.wanted_gap - np.max(self.room_lacking(q)))

    @abstractmethod
    def keyframes_along(
        self, keyframes: FloatArray, spline: BSpline, *, legs: bool
    ) -> tuple[FloatArray, BSpline, tuple[Configuration, ...]]:
        """Return the keyframes and path of the joints, and the curves that the arm follows, where it follows any.

        Args:
            keyframes: of a motion, shape (K, c).
            spline: the path along it.
            legs: whether the arm will move on straight legs between the keyframes.
        """

    def violated_place(self, spline: BSpline) -> Diagnosis | None:
        """Return what besides limits a path misses, in words; None where it misses nothing."""
        del spline
        return None

    @property
    def constraints(self) -> tuple[str, ...]:
        """Names of the user's hard constraints."""
        return tuple(name for limit in self.user_limits for name in limit.names)

    @property
    def parametric(self) -> bool:
        """Whether a limit depends on the path parameter, so that a motion has to be tracked under it."""
        return any(limit.parametric for limit in self.user_limits)

    @property
    def limited_goal(self) -> GoalPose:
        """The goal with the limits that hold there."""
        return self.limited(self.goal)

    def limited(self, goal: GoalPose) -> GoalPose:
        """Return a goal with the limits that hold at the end of the motion."""
        limits = tuple(limit.placed_at_goal() for limit in self.user_limits)
        return replace(goal, limits=limits, settings=self.settings.goal)


AskedType = TypeVar("AskedType")
"""What a strategy is given: a task, or a run of the search for one."""
FoundType = TypeVar("FoundType")
"""What it finds."""


@dataclass(frozen=True)
class Strategy(Generic[AskedType, FoundType]):
    """One way to look for a motion.

    Attributes:
        name: for the record of a search in vain.
        find: a certified motion, or None and what was tried added to the failures.
        applies: whether it can find motions.
        costly: whether it may take so long that a proof that there is no motion is worth some tenths of a second first.
        leads_others: whether later strategies begin with what it tries, so that few links in vain are enough of it.
    """

    name: str
    find: Callable[[AskedType, list[Failure]], FoundType | None]
    applies: Callable[[AskedType], bool] = lambda _: True
    costly: bool = False
    leads_others: bool = False


StrategyType = TypeVar("StrategyType", bound=Strategy[Any, Any])
"""The kind of strategy."""


def first_found(
    strategies: Iterable[StrategyType],
    task: SearchTask,
    find: Callable[[StrategyType, list[Failure]], FoundType | None],
) -> FoundType:
    """Return what the first strategy finds that finds anything; what comes after the deadline is only listed.

    Args:
        strategies: that apply, the cheap ones first.
        task: what is looked for.
        find: what a strategy finds; adds what it tried in vain to the failures.

    Raises:
        MotionNotFound: every strategy failed; the diagnosis lists why.
        TimeLimitReached: the deadline passed first.
        UnreachableGoal: it is proved that there is none.
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
    """Return the error that says why no motion was found.

    Args:
        task: what was looked for.
        failures: of every attempt.
        strategies: that were tried, in turn.
    """
    tried = sorted(failures, key=lambda f: f.remaining)
    trees = [f.message for f in failures if f.candidate == TREES]
    held: tuple[str, ...] = ()
    if tried:
        best = tried[0]
        what = "the tip" if task.goal_pose is None else "a joint"
        reason = (
            f"no motion found in {len(tried) - len(trees)} candidates; the best ({best.candidate}) ended with "
            f"{what} {short_length(best.remaining)} from the goal: {best.message}; tightest there: "
            f"{best.obstacle}"
        ) + "".join(f"; {ended}" for ended in trees if ended != best.message)
        joints, held = joints_at_limits(best.bends, task.arm.bend_limits)
        reason += f"; {joints}" if joints else ""
    else:
        reason = "no motion found: no route to the goal was found that the arm is thin and long enough for"
    reason += _limits_in_the_way(task.constraints, tried)
    reason += _how_far(strategies)
    figures = {**evidence(tried), "strategies": [asdict(each) for each in strategies]}
    relaxed = ("relax the constraints, or make them soft",) if task.constraints else ()
    what_held = (*relaxed, *held, *_way_made(tried), *room_advice(task.arm.radius, task.kept - task.arm.radius))
    if any(not each.exhausted for each in strategies):
        reason = f"{task.deadline.what_passed()}: {reason}"
        advice = (*what_held, "raise planner.time_limit")
        return TimeLimitReached(Diagnosis(reason, "motion", advice, figures))
    advice = (*what_held, task.advice, *(() if held else ("raise arm.joint_limit_deg",)), "use a longer arm")
    return MotionNotFound(Diagnosis(reason, "motion", advice, figures))


def _way_made(tried: Sequence[Failure]) -> tuple[str, ...]:
    """Return what is advised about the wall that the best attempt nearly touched where it ended."""
    if not tried or tried[0].tightest is None:
        return ()
    link, name, gap = tried[0].tightest
    if name.startswith("link "):
        return ()
    return (f"make room at {name}: link {link} was {short_length(gap)} from it where the best attempt ended",)


def _how_far(strategies: Sequence[StrategyInVain]) -> str:
    """Return which strategies were exhausted, and which the time cut short, in words."""
    # What had nothing to try says nothing of the problem.
    exhausted = [f"{each.name} ({_attempts(each)})" for each in strategies if each.exhausted and each.attempts]
    cut_short = [f"{each.name} ({_attempts(each)})" for each in strategies if not each.exhausted]
    words = f"; exhausted: {', '.join(exhausted)}" if exhausted else ""
    return f"{words}; cut short: {', '.join(cut_short)}" if cut_short else words


def _attempts(strategy: StrategyInVain) -> str:
    return {0: "nothing tried", 1: "1 attempt"}.get(strategy.attempts, f"{strategy.attempts} attempts")


def evidence(tried: Sequence[Failure]) -> Mapping[str, object]:
    """Return the figures behind a reason, all JSON-serialisable; failures come sorted, the best first.

    Returns:
        ``tried``: a line for each; ``candidates``: the same as tables; ``in_the_way``: how often what was the tightest
        contact; ``nearest_pose``: the configuration where the best ended.
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
    """Return the constraint in the way of the candidate that came nearest, or all of them."""
    if not names:
        return ""
    met = [failure.limit for failure in tried if failure.limit]
    if met:
        return f"; {met[0]} where candidates ended ({len(met)} of {len(tried)} at a constraint)"
    return "; under " + ", ".join(f"constraint '{name}'" for name in names)
