"""Pareto trade-off between duration and clearance: plans from the fastest to the one with maximum clearance."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from ccm_opt.core.arguments import expect
from ccm_opt.core.errors import CancelledWithPlan, NoPlanFound, ProblemError, VerificationError
from ccm_opt.core.length_words import words_in
from ccm_opt.core.progress import Progress
from ccm_opt.diagnosis.possible_gap import possible_gap
from ccm_opt.driver.arguments import expect_arguments, refuse_free_order
from ccm_opt.driver.clearance_over_time import clearance_over_time
from ccm_opt.driver.pipeline import solve
from ccm_opt.driver.settings import DEFAULT_SETTINGS, Settings
from ccm_opt.ik.terms import Constraint, Cost
from ccm_opt.problem import Problem
from ccm_opt.problem.solution import ParetoPlan, ParetoPlans, Solution


@dataclass(frozen=True)
class ParetoSettings:
    """Settings of the trade-off between duration and clearance; all values are chosen by hand.

    Attributes:
        shares: preferred clearances of the plans after the first, as fractions of the range from the clearance that the
            first plan keeps without a preference up to the maximum preferred clearance; the last must be 1.
        most: maximum preferred clearance, as a multiple of the default; an upper bound on the clearance of any motion
            replaces this value if it is less.
        least_top: fraction of the default preferred clearance below which such an upper bound is ignored. The bound
            often comes from a start or goal with almost no clearance, between which a motion can keep more.
        enough_of_top: fraction of the maximum preferred clearance that the plan for this value must keep; otherwise the
            clearance that the plan kept becomes the maximum, so that the plans differ.
        narrowings: maximum number of times that the maximum preferred clearance is reduced in this way.
        most_time: fraction by which the recommended plan may take longer than the fastest.
        same_gap: difference up to which clearances count as equal, as a fraction of the arm's length.
        same_time: relative difference up to which durations count as equal.
    """

    shares: tuple[float, ...] = (0.25, 0.5, 0.75, 1.0)
    most: float = 4.0
    least_top: float = 0.5
    enough_of_top: float = 0.9
    narrowings: int = 2
    most_time: float = 0.15
    same_gap: float = 1e-4
    same_time: float = 1e-3


DEFAULT_PARETO = ParetoSettings()
"""Default settings of the trade-off between duration and clearance."""


def pareto(
    problem: Problem,
    *,
    progress: Callable[[Progress], None] | None = None,
    constraints: Sequence[Constraint] = (),
    costs: Sequence[Cost] = (),
    explain: bool = True,
    settings: Settings | None = None,
    trade_off: ParetoSettings = DEFAULT_PARETO,
) -> ParetoPlans:
    """Return several plans of a problem, from the fastest to the one with maximum clearance.

    The first plan has no preferred clearance. The preferred clearances of the others lie between the clearance that the
    first plan keeps and a maximum: a multiple of the default or, if that is less, an upper bound for any motion.
    Every plan has the problem's full time limit.

    Args:
        problem: the problem, planar or in space; its ``wanted_gap`` is ignored.
        progress: as for ``solve``, with the number of the plan before the name of the stage.
        constraints: constraints of the user, as for ``solve``.
        costs: costs of the user, as for ``solve``.
        explain: whether to find the cause of a failure of the first plan, and helpful changes.
        settings: settings of all stages of planning; None for the defaults.
        trade_off: preferred clearances, and criteria for the recommended plan.

    Returns:
        The plans; all but the first may hold a reason of failure instead of a solution.

    Raises:
        ProblemError: the problem is invalid, or its planner does not support preferred clearances.
        NoPlanFound: no plan was found even without a preferred clearance.
        VerificationError: the verifier rejects the first plan.
        CancelledWithPlan: Ctrl-C was pressed after the first plan was found, which the error holds.
    """
    Problem.expected(problem)
    expect_arguments(progress=progress, settings=settings, explain=explain)
    expect(trade_off, ParetoSettings, "ParetoSettings for trade_off=")
    _refuse_planners_without_gaps(problem)
    refuse_free_order(problem, "trade-offs of duration and clearance are")
    numbers = settings or DEFAULT_SETTINGS

    def solved(wanted_gap: float, number: int, *, explain: bool = False) -> Solution:
        def numbered(news: Progress) -> None:
            if progress is not None:
                progress(replace(news, stage=f"plan {number}: {news.stage}"))

        options = replace(problem.planner, wanted_gap=wanted_gap)
        return solve(
            replace(problem, planner=options, source=""),
            progress=numbered,
            constraints=constraints,
            costs=costs,
            explain=explain,
            settings=numbers,
        )

    def tried(wanted_gap: float, number: int) -> ParetoPlan:
        try:
            solution = solved(wanted_gap, number)
        except NoPlanFound as failure:
            return ParetoPlan(wanted_gap, None, failure.diagnosis.reason)
        except VerificationError as failure:
            return ParetoPlan(wanted_gap, None, "the verifier rejects the plan: " + "; ".join(failure.failures))
        return ParetoPlan(wanted_gap, solution, cpu=_planning_time(solution))

    with words_in(problem.length_unit):
        first = solved(0.0, 1, explain=explain)
        plans: list[ParetoPlan] = [ParetoPlan(0.0, first, cpu=_planning_time(first))]
        try:
            roomiest = _largest_gap_try(first, tried, numbers, trade_off)
            # Gaps that the fastest plan keeps anyway need not be asked for.
            low = plans[0].gap if 0.0 < plans[0].gap < roomiest.wanted_gap else 0.0
            for number, share in enumerate(trade_off.shares[:-1], start=2):
                plans.append(tried(low + share * (roomiest.wanted_gap - low), number))
        except KeyboardInterrupt as interrupt:
            raise CancelledWithPlan(first) from interrupt
    plans = [_priced(plan, first.trajectory.duration) for plan in (*plans, roomiest)]
    judgement = Judgement(plans, roomiest.wanted_gap, problem.arm.length, trade_off)
    judged = tuple(replace(plan, dominated_by=judgement.dominator(plan)) for plan in plans)
    return ParetoPlans(problem, judged, judgement.recommended(), trade_off.most_time)


def _largest_gap_try(
    fastest: Solution, tried: Callable[[float, int], ParetoPlan], settings: Settings, trade_off: ParetoSettings
) -> ParetoPlan:
    """Return the plan for the maximum preferred clearance.

    The maximum is a multiple of the default preferred clearance or, if that is less, an upper bound on the clearance of
    any motion. If the plan keeps much less clearance, it is made again with that clearance as the maximum.

    Args:
        fastest: plan without preferred clearance.
        tried: function that makes a plan, given the preferred clearance [m] and the plan's number.
        settings: settings of all stages of planning.
        trade_off: settings of the trade-off.
    """
    problem = fastest.problem
    usual = problem.default_gap
    top = trade_off.most * usual
    room = clearance_over_time(problem, fastest.trajectory, top, fastest.checks, settings.room, settings.verification)
    bound = possible_gap(problem, room)
    if bound is not None and bound.value >= trade_off.least_top * usual:
        top = min(top, bound.value)
    number = len(trade_off.shares) + 1
    plan = tried(top, number)
    for _ in range(trade_off.narrowings):
        if (
            plan.solution is None
            or not trade_off.least_top * usual <= plan.gap < trade_off.enough_of_top * plan.wanted_gap
        ):
            break
        # The scene is narrower than the bounds say: ask for the gap that this plan kept.
        plan = tried(plan.gap, number)
    return plan


def _refuse_planners_without_gaps(problem: Problem) -> None:
    """Raise an error for planar problems whose planner does not support preferred clearances."""
    if problem.dimension == 3:
        return
    if problem.arm.base_axes or problem.planner.method != "nlp":
        raise ProblemError(
            f'{problem.name}: the trade-off needs a fixed base and planner.method = "nlp"; otherwise there is no '
            "preferred clearance to vary"
        )


def _planning_time(solution: Solution) -> float:
    """Return the CPU time of all stages that made a plan, except the simulation [s]."""
    return sum(seconds for stage, seconds in solution.timings.items() if stage != "simulation")


def _priced(plan: ParetoPlan, fastest: float) -> ParetoPlan:
    """Return a plan whose record of clearance also holds the additional duration compared with the fastest plan."""
    solution = plan.solution
    if solution is None or solution.room is None or plan.wanted_gap == 0.0:
        return plan
    room = replace(solution.room, price=solution.trajectory.duration - fastest)
    return replace(plan, solution=solution.with_clearance_record(room))


@dataclass(frozen=True)
class Judgement:
    """Comparison of plans by duration and clearance, where clearance is capped at the maximum preferred clearance.

    Attributes:
        plans: all plans, from the fastest to the one with maximum clearance.
        most_gap: the maximum preferred clearance [m].
        length: length of the arm [m].
        trade_off: tolerances of equality, and criteria for the recommended plan.
    """

    plans: Sequence[ParetoPlan]
    most_gap: float
    length: float
    trade_off: ParetoSettings

    def dominator(self, plan: ParetoPlan) -> int:
        """Return the number, from 1, of a plan that dominates this one; 0 if there is none.

        It is no worse in duration and capped clearance, and better in one of them, beyond the tolerances of equality.
        """
        if plan.solution is None:
            return 0
        gap = self.worth(plan)
        shorter = plan.duration * (1.0 - self.trade_off.same_time)
        longer = plan.duration * (1.0 + self.trade_off.same_time)
        for number, other in enumerate(self.plans, start=1):
            no_worse = other.duration <= longer and self.worth(other) >= gap - self._same_gap
            better = other.duration < shorter or self.worth(other) > gap + self._same_gap
            if no_worse and better:
                return number
        return 0

    def recommended(self) -> int:
        """Return the number, from 1, of the recommended plan.

        Of the plans that are not dominated and take at most ``most_time`` longer than the fastest, this is the one with
        maximum clearance.
        """
        most = (1.0 + self.trade_off.most_time) * min(plan.duration for plan in self.plans)
        eligible = [
            number
            for number, plan in enumerate(self.plans, start=1)
            if plan.duration <= most and not self.dominator(plan)
        ]
        return max(eligible, key=lambda number: self._rank(self.plans[number - 1]))

    @property
    def _same_gap(self) -> float:
        """Difference up to which two clearances count as equal [m]."""
        return self.trade_off.same_gap * self.length

    def worth(self, plan: ParetoPlan) -> float:
        """Return the minimum clearance of a plan, capped at the maximum preferred clearance [m]."""
        return min(plan.gap, self.most_gap)

    def _rank(self, plan: ParetoPlan) -> tuple[float, float]:
        return self.worth(plan), -plan.duration
