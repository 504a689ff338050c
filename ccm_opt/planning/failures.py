"""Why no motion was found: what every candidate ended at, and in words what stood in the way of the best."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.length_words import short_length
from ccm_opt.errors import Diagnosis, MotionNotFound, TimeLimitReached
from ccm_opt.planning.motion_task import MotionTask
from ccm_opt.planning.tree_search import TREES
from ccm_opt.scene.bad_pose import joints_at_limits, room_advice


@dataclass(frozen=True)
class Failure:
    """Why one candidate failed.

    Attributes:
        candidate: its name.
        message: how far it came.
        obstacle: the tightest contact there, in words.
        remaining: distance of the tip, or with a goal for the whole arm of the farthest joint, from the goal [m].
        limit: what of the user's constraints is in the way, in words, or empty.
        tightest: link, counted from 1, name of what it nearly touches, and the gap [m]; None when nothing is near.
        headings: of the links where it ended, shape (links,) [rad].
    """

    candidate: str
    message: str
    obstacle: str
    remaining: float
    limit: str
    tightest: tuple[int, str, float] | None
    headings: FloatArray


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


def nothing_found(
    task: MotionTask, failures: Sequence[Failure], strategies: Sequence[StrategyInVain]
) -> MotionNotFound | TimeLimitReached:
    """The error that says why no motion was found.

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
        what = "the tip" if task.goal_headings is None else "a joint"
        reason = (
            f"no motion found in {len(tried) - len(trees)} candidates; the best ({best.candidate}) ended with {what} "
            f"{short_length(best.remaining)} from the goal: {best.message}; tightest there: {best.obstacle}"
        ) + "".join(f"; {ended}" for ended in trees if ended != best.message)
        joints, held = joints_at_limits(task.arm.bends(best.headings), task.arm.bend_limits)
        reason += f"; {joints}" if joints else ""
    else:
        reason = "no motion found: no route to the goal was found that the arm is thin and long enough for"
    reason += _limits_in_the_way(task, tried)
    reason += _how_far(strategies)
    figures = {**evidence(tried), "strategies": [asdict(each) for each in strategies]}
    first = tuple(words for limit in task.user_limits for words in limit.advice)
    what_held = (*first, *held, *_way_made(tried), *room_advice(task.arm, task.workspace))
    if any(not each.exhausted for each in strategies):
        reason = f"{task.deadline.what_passed()}: {reason}"
        advice = (*what_held, "raise planner.time_limit")
        return TimeLimitReached(Diagnosis(reason, "motion", advice, figures))
    advice = (*what_held, "raise planner.routes", *(() if held else ("raise arm.joint_limit_deg",)), "use a longer arm")
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
    """Which strategies were exhausted, and which the time cut short, in words."""
    # What had nothing to try says nothing of the problem.
    exhausted = [f"{each.name} ({_attempts(each)})" for each in strategies if each.exhausted and each.attempts]
    cut_short = [f"{each.name} ({_attempts(each)})" for each in strategies if not each.exhausted]
    words = f"; exhausted: {', '.join(exhausted)}" if exhausted else ""
    return f"{words}; cut short: {', '.join(cut_short)}" if cut_short else words


def _attempts(strategy: StrategyInVain) -> str:
    return {0: "nothing tried", 1: "1 attempt"}.get(strategy.attempts, f"{strategy.attempts} attempts")


def evidence(tried: Sequence[Failure]) -> Mapping[str, object]:
    """The figures behind a reason, all JSON-serialisable; failures come sorted, the best first.

    Returns:
        ``tried``: a line for each; ``candidates``: the same as tables; ``in_the_way``: how often what was the tightest
        contact; ``nearest_pose``: link headings where the best ended [rad].
    """
    named = Counter(f.tightest[1] for f in tried if f.tightest is not None)
    return {
        "tried": [f"{f.candidate}: {f.message} ({f.obstacle})" for f in tried],
        "candidates": [_table(f) for f in tried],
        "in_the_way": dict(named.most_common()),
        "nearest_pose": np.asarray(tried[0].headings).tolist() if tried else [],
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


def _limits_in_the_way(task: MotionTask, tried: list[Failure]) -> str:
    """The constraint in the way of the candidate that came nearest, or all of them."""
    names = [name for limit in task.user_limits for name in limit.names]
    if not names:
        return ""
    met = [failure.limit for failure in tried if failure.limit]
    if met:
        return f"; {met[0]} where candidates ended ({len(met)} of {len(tried)} at a constraint)"
    return "; under " + ", ".join(f"constraint '{name}'" for name in names)
