"""Plans from the fastest to the roomiest."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from ccm_opt.core.arguments import expect
from ccm_opt.core.errors import CancelledWithPlan, NoPlanFound, ProblemError, VerificationError
from ccm_opt.core.length_words import words_in
from ccm_opt.core.progress import Progress
from ccm_opt.diagnosis.possible_gap import possible_gap
from ccm_opt.driver.arguments import expect_arguments
from ccm_opt.driver.pipeline import solve
from ccm_opt.driver.room_over_time import room_over_time
from ccm_opt.driver.settings import DEFAULT_SETTINGS, Settings
from ccm_opt.ik.terms import Constraint, Cost
from ccm_opt.problem import Problem
from ccm_opt.problem.solution import ParetoPlan, ParetoPlans, Solution


@dataclass(frozen=True)
class ParetoSettings:
    """Numbers of the trade-off; all of them are taste.

    Attributes:
        shares: wanted gaps of the plans after the first, as shares of the way from the gap that the first keeps
            unasked to the largest; the last must be 1. The largest is ``most`` times the default, or the upper bound of
            what the scene has where that is less.
        most: the largest wanted gap, in default ones.
        least_top: share of the default wanted gap below which a bound does not shrink the wanted gaps: where an end has
            next to nothing, the motion can still keep room elsewhere.
        enough_of_top: share of the largest wanted gap that its plan must keep; where the scene proves narrower, the gap
            that it kept takes its place, so that the five plans differ.
        narrowings: times that this may happen; wanting what another motion kept need not lead to that motion.
        most_time: share of the fastest plan's duration by which the recommended one may be slower.
        same_gap: gaps that differ by less than this share of the arm's length count as equal.
        same_time: durations that differ by less than this share count as equal.
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
"""Used where no other settings are given."""


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
    """Plan a problem, in the plane or in space, several times, from the fastest motion to the roomiest.

    The first plan wants no gap. The others want gaps between the one that it keeps unasked and the largest that makes
    sense in the scene: some times the default, or, where that is less, what any motion can keep. Every plan has the
    problem's time limit for itself.

    Args:
        problem: what to solve; its own ``wanted_gap`` is not used.
        progress: as for ``solve``, with the number of the plan before the name of the stage.
        constraints: of the user, as ``solve`` takes them.
        costs: of the user, likewise.
        explain: whether it is explained why there is no plan when there is none at all.
        settings: numbers of the stages that the problem does not set; the defaults when None.
        trade_off: which gaps are wanted, and what is recommended.

    Returns:
        The plans, all but the first perhaps without a solution but with a reason.

    Raises:
        ProblemError: the problem cannot be used as it stands, or its planner knows no wanted gaps.
        NoPlanFound: there is no plan for the first wanted gap, which asks for nothing.
        VerificationError: the verifier refuses that plan.
        CancelledWithPlan: on Ctrl-C once there is the first plan, which it holds.
    """
    Problem.expected(problem)
    expect_arguments(progress=progress, settings=settings, explain=explain)
    expect(trade_off, ParetoSettings, "ParetoSettings for trade_off=")
    _refuse_planners_without_gaps(problem)
    numbers = settings or DEFAULT_SETTINGS

    def solved(wanted_gap: float, number: int, *, explain: bool = False) -> Solution:
        def numbered(told: Progress) -> None:
            if progress is not None:
                progress(replace(told, stage=f"plan {number}: {told.stage}"))

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
            return ParetoPlan(wanted_gap, None, "the verifier refuses the plan: " + "; ".join(failure.failures))
        return ParetoPlan(wanted_gap, solution, cpu=_planning_time(solution))

    with words_in(problem.length_unit):
        first = solved(0.0, 1, explain=explain)
        plans: list[ParetoPlan] = [ParetoPlan(0.0, first, cpu=_planning_time(first))]
        try:
            roomiest = _roomiest(first, tried, numbers, trade_off)
            # What the fastest keeps unasked is no wish.
            low = plans[0].gap if 0.0 < plans[0].gap < roomiest.wanted_gap else 0.0
            for number, share in enumerate(trade_off.shares[:-1], start=2):
                plans.append(tried(low + share * (roomiest.wanted_gap - low), number))
        except KeyboardInterrupt as interrupt:
            raise CancelledWithPlan(first) from interrupt
    plans = [_priced(plan, first.trajectory.duration) for plan in (*plans, roomiest)]
    judgement = Judgement(plans, roomiest.wanted_gap, problem.arm.length, trade_off)
    judged = tuple(replace(plan, dominated_by=judgement.dominator(plan)) for plan in plans)
    return ParetoPlans(problem, judged, judgement.recommended(), trade_off.most_time)


def _roomiest(
    fastest: Solution, tried: Callable[[float, int], ParetoPlan], settings: Settings, trade_off: ParetoSettings
) -> ParetoPlan:
    """Return the plan for the largest wanted gap that the scene has.

    That is some times the default, or what any motion can keep at most.
    """
    problem = fastest.problem
    usual = problem.default_gap
    top = trade_off.most * usual
    room = room_over_time(problem, fastest.trajectory, top, fastest.checks, settings.room, settings.verification)
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
        # No bound knew how narrow the scene is, but this plan does.
        plan = tried(plan.gap, number)
    return plan


def _refuse_planners_without_gaps(problem: Problem) -> None:
    """Refuse planners that know no wanted gaps; that of arms in space does, with a feed axis too."""
    if problem.dimension == 3:
        return
    if problem.arm.base_axes or problem.planner.method != "nlp":
        raise ProblemError(
            f'{problem.name}: plans for several wanted gaps need a fixed base and planner.method "nlp"; '
            "other planners do not know wanted gaps"
        )


def _planning_time(solution: Solution) -> float:
    """Return the CPU time of everything but the simulation [s]."""
    return sum(seconds for stage, seconds in solution.timings.items() if stage != "simulation")


def _priced(plan: ParetoPlan, fastest: float) -> ParetoPlan:
    """Return the plan with what its wanted gap costs in time."""
    solution = plan.solution
    if solution is None or solution.room is None or plan.wanted_gap == 0.0:
        return plan
    room = replace(solution.room, price=solution.trajectory.duration - fastest)
    return replace(plan, solution=solution.with_room(room))


@dataclass(frozen=True)
class Judgement:
    """Compares plans by their durations and gaps; room above the largest wanted gap is worth nothing.

    Attributes:
        plans: in order.
        most_gap: the largest wanted gap [m].
        length: of the arm [m].
        trade_off: what counts as equal, and how much slower the recommended plan may be.
    """

    plans: Sequence[ParetoPlan]
    most_gap: float
    length: float
    trade_off: ParetoSettings

    def dominator(self, plan: ParetoPlan) -> int:
        """Number of a plan that is no worse in time and room and better in one of them; 0 when there is none."""
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
        """Number of the roomiest plan that is not much slower than the fastest, and not dominated."""
        most = (1.0 + self.trade_off.most_time) * min(plan.duration for plan in self.plans)
        eligible = [
            number
            for number, plan in enumerate(self.plans, start=1)
            if plan.duration <= most and not self.dominator(plan)
        ]
        return max(eligible, key=lambda number: self._rank(self.plans[number - 1]))

    @property
    def _same_gap(self) -> float:
        """Gaps that differ by less count as equal [m]."""
        return self.trade_off.same_gap * self.length

    def worth(self, plan: ParetoPlan) -> float:
        """Return the its least gap as far as it counts [m]."""
        return min(plan.gap, self.most_gap)

    def _rank(self, plan: ParetoPlan) -> tuple[float, float]:
        return self.worth(plan), -plan.duration
