"""The search for a motion: every strategy in turn until one finds a certified motion, then its optimisation.

Arms of many links are planned with few links in the same coordinates and lifted; when that fails, or the arm has few
links, they are planned on their own links.
"""

from itertools import chain
from math import ceil

from ccm_opt.motion.ending import optimised_to_end_pose
from ccm_opt.motion.failures import Failure, StrategyInVain, nothing_found
from ccm_opt.motion.lifting import lift
from ccm_opt.motion.motion_task import Motion, MotionTask, coarsened
from ccm_opt.motion.optimisation.optimise import optimise
from ccm_opt.motion.passage_widths import fitting_margins, nominal_links_asked
from ccm_opt.motion.search_run import SearchRun
from ccm_opt.motion.straightening import straightened
from ccm_opt.motion.strategies import STRATEGIES, SearchStrategy


def find_motion(task: MotionTask, strategies: tuple[SearchStrategy, ...] = STRATEGIES) -> Motion:
    """Find a certified motion from the start to the goal.

    Args:
        task: arm, room, ends and limits.
        strategies: tried in turn, those that apply.

    Raises:
        MotionNotFound: every candidate failed; the diagnosis lists why.
        TimeLimitReached: the deadline passed first.
        UnreachableGoal: it is proved that there is none.
    """
    ends = [task.start] if task.goal_headings is None else [task.start, task.goal_headings]
    if any(task.bends_all_it_may(end) for end in ends):
        task = task.at_full_limits()
    failures: list[Failure] = []
    in_vain: list[StrategyInVain] = []
    nominal_links = nominal_links_asked(task)
    coarse = _coarse_task(task, nominal_links)
    asked = False
    for strategy in strategies:
        if not strategy.applies(task):
            continue
        if strategy.costly and not asked:
            task.refuse()
            asked = True
        before = len(failures)
        if coarse is not None:
            # Few links at first: the cost of a step grows with their number, while a curve of 22 coordinates does not.
            found = strategy.find(coarse, failures, nominal_links)
            motion = _taken_over(found, coarse, task, nominal_links, failures) if found is not None else None
            if motion is not None:
                return motion
        if coarse is None or not strategy.leads_others:
            motion = strategy.find(task, failures, nominal_links)
            if motion is not None:
                return optimised_to_end_pose(straightened(motion, task), task)
        in_vain.append(StrategyInVain(strategy.name, len(failures) - before, not task.deadline.passed()))
    raise nothing_found(task, failures, in_vain)


def _coarse_task(task: MotionTask, nominal_links: float) -> MotionTask | None:
    """The task with as few links as its passages let through; None where that does not pay, or is not possible."""
    settings = task.settings.search
    # Narrow passages need short links.
    links = max(settings.design_links, 2 * ceil(0.5 * nominal_links))
    resamples = all(limit.resamples for limit in task.user_limits)
    if task.arm.links <= settings.many_links * links or not resamples or task.clamped:
        return None
    # What lies in the middle of a gate with few links lies beside it with many.
    if task.gates is not None:
        return None
    return coarsened(task, links)


def _taken_over(
    found: Motion, coarse: MotionTask, task: MotionTask, nominal_links: float, failures: list[Failure]
) -> Motion | None:
    """The coarse motion on the task's links, optimised: lifted, or else found again; None where neither can be."""
    lifted = _lifted(found, coarse, task)
    if lifted is not None:
        return lifted
    again = _found_again(found, task, nominal_links, failures)
    return optimised_to_end_pose(straightened(again, task), task) if again is not None else None


def _lifted(found: Motion, coarse: MotionTask, task: MotionTask) -> Motion | None:
    """A coarse motion on the task's links: optimised and lifted, or else lifted as it was found and then optimised."""
    # An optimised motion hugs the walls, and the links of the finer arm lie elsewhere; hence the wider margin. Where it
    # still cannot be lifted, the motion as it was found has more room.
    optimised = optimised_to_end_pose(straightened(found, coarse), coarse, task.settings.search.lift_margin)
    lifted = lift(optimised, task)
    if lifted is not None or optimised is found:
        return lifted
    lifted = lift(found, task)
    return optimise(lifted, task) if lifted is not None else None


def _found_again(found: Motion, task: MotionTask, nominal_links: float, failures: list[Failure]) -> Motion | None:
    """The motion of the candidate that arrived with few links, tried with the task's own; None where it does not.

    In narrow places the finer arm swings out beside the chords of the coarse one, and no repair brings a thin link
    back through a wall; but what leads the one mostly leads the other.
    """
    margin = fitting_margins(task, task.settings.search.margins, nominal_links)[0]
    run = SearchRun.from_task(task, margin, nominal_links)
    return run.run((each for each in chain(run.first(), run.further()) if each.name == found.candidate), failures)
