"""Check that a motion to goals in free order accounts for every goal, and the goals in the order of the visits."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace

from ccm_opt.core.errors import ProblemError
from ccm_opt.problem import Problem, Stop, Tolerances
from ccm_opt.problem.solution import Check, JointTrajectory, Tour
from ccm_opt.verification.verification_settings import VerificationSettings


def check_order(problem: Problem, tour: Tour | None) -> list[Check]:
    """Check that each goal in free order is either visited once or said to be left out, and where the motion ends.

    The worst value is the number of goals for which that fails. Whether the motion is at a goal at its time is checked
    as for goals in given order.

    Args:
        problem: the problem as posed.
        tour: order of the visits and goals left out; None for goals in given order, which need no check.

    Raises:
        ProblemError: the goals are in free order without a tour, or in given order with one.
    """
    if (problem.planner.order == "free") != (tour is not None):
        raise ProblemError('a tour goes together with planner.order = "free"; solutions and loaded plans have one')
    if tour is None:
        return []
    if (problem.coverage is not None) != bool(tour.views):
        raise ProblemError("views go together with a problem that has surfaces to be seen")
    count = len(_goals(problem, tour))
    named = Counter([*tour.order, *(goal.goal for goal in tour.left_out)])
    wrong = sorted(
        {number for number in range(1, count + 1) if named[number] != 1} | {k for k in named if not 0 < k <= count}
    )
    where = f"goals {', '.join(map(str, wrong))}" if wrong else f"{len(tour.order)} of {count} goals"
    if not tour.order:
        wrong, where = [0], "no goal is visited"
    elif problem.planner.end == "last" and tour.order[-1] != count:
        wrong, where = [*wrong, count], f"the motion ends at goal {tour.order[-1]}, not at the last one"
    return [Check("order of goals", float(len(wrong)), 0.0, "goals", where, passed=not wrong)]


def _goals(problem: Problem, tour: Tour) -> Sequence[Stop]:
    """Return the goals of which a tour has the numbers: the problem's, or those found for what it has to see."""
    return tour.views or problem.numbered_goals


def check_tour_times(
    problem: Problem, tour: Tour | None, trajectory: JointTrajectory, settings: VerificationSettings
) -> list[Check]:
    """Check the duration that a tour states against the motion, and what it states of other orders against that.

    The worst value is the largest amount by which a statement is off [s].

    Args:
        problem: the problem of the goals that are visited, in the order of the visits.
        tour: order of the visits; None for goals in given order, which need no check.
        trajectory: the motion.
        settings: tolerances of the verifier.
    """
    if tour is None:
        return []
    moving = float(trajectory.time[-1] - trajectory.time[0]) - sum(stop.pause for stop in problem.stops)
    longer = tour.duration - tour.as_given
    off = {
        f"{tour.duration:.6g} s stated, the motion has {moving:.6g} s": abs(tour.duration - moving),
        f"the bound of {tour.bound:.6g} s for all orders": tour.bound - tour.duration,
        f"{tour.as_given:.6g} s stated for the given order": abs(longer) if tour.in_given_order else longer,
    }
    where = max(off, key=lambda words: off[words])
    worst = max(off[where], 0.0)
    # Stated durations are sums over the motions, rounded like the times of their samples.
    limit = settings.time_rounding * len(trajectory.time)
    return [Check("duration of the tour", worst, limit, "s", where, passed=worst <= limit)]


def in_order(problem: Problem, tour: Tour | None) -> Problem:
    """Return the problem of the goals that a tour visits, in the order of the visits, then of the way back, if any.

    Args:
        problem: the problem as posed.
        tour: order of the visits; None for goals in given order, with which the problem is returned as it is.
    """
    if tour is None:
        return problem
    goals = _goals(problem, tour)
    visits = [goals[number - 1] for number in tour.order]
    if problem.planner.end == "start":
        visits.append(Stop(problem.start, Tolerances()))
    return replace(
        problem,
        stops=tuple(visits[:-1]),
        goal=visits[-1].goal,
        tolerances=visits[-1].tolerances,
        pause=visits[-1].pause,
        planner=replace(problem.planner, order="given", end="free"),
    )
