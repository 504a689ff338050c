"""The search for a motion: one attempt after the other, and why there is none.

What every candidate ended at is kept, and said in words with what stood in the way of the best.
"""

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Protocol, TypeVar

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.deadline import Deadline
from ccm_opt.core.errors import Diagnosis, MotionNotFound, TimeLimitReached
from ccm_opt.core.length_words import short_length
from ccm_opt.core.progress import tell_candidate
from ccm_opt.scene.bad_pose import joints_at_limits, room_advice

AttemptT = TypeVar("AttemptT", bound="Attempt")

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
        bends: of the joints there, shape (links,) or (links, 2) [rad].
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
    tell_candidate(len(failures) + 1, candidate, min((failure.remaining for failure in failures), default=np.inf))


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


@dataclass(frozen=True)
class Sought:
    """What a search in vain looked for, as far as the reason says it.

    Attributes:
        radius: of the arm [m].
        clearance: that walls are kept beyond it [m].
        bend_limits: of the joints, as many as there are bends [rad].
        deadline: when it had to stop.
        constraints: names of the user's hard constraints.
        ends_with: what has to come to the goal, in words.
        advice: what may help where nothing better is known.
    """

    radius: float
    clearance: float
    bend_limits: FloatArray
    deadline: Deadline
    constraints: Sequence[str]
    ends_with: str
    advice: tuple[str, ...]


class Attempt(Protocol):
    """One way to look for a motion.

    Attributes:
        name: for the record of a search in vain.
        costly: whether it may take so long that a proof that there is no motion is worth some tenths of a second first.
    """

    @property
    def name(self) -> str: ...  # noqa: D102
    @property
    def costly(self) -> bool: ...  # noqa: D102


def in_turn(
    attempts: Iterable[AttemptT],
    sought: Sought,
    failures: list[Failure],
    refuse: Callable[[], None],
    in_vain: list[StrategyInVain],
) -> Iterator[AttemptT]:
    """Attempts in turn, for whoever stops at the first that finds a motion.

    Args:
        attempts: the cheap ones first; each is asked for when those before have failed.
        sought: what is looked for.
        failures: to which attempts add what they tried.
        refuse: raises where it is proved that there is no motion; asked once, before what takes long.
        in_vain: is added to.

    Raises:
        UnreachableGoal: it is proved that there is none.
    """
    asked = False
    for attempt in attempts:
        if attempt.costly and not asked:
            refuse()
            asked = True
        before = len(failures)
        yield attempt
        in_vain.append(StrategyInVain(attempt.name, len(failures) - before, not sought.deadline.passed()))


def nothing_found(
    sought: Sought, failures: Sequence[Failure], strategies: Sequence[StrategyInVain]
) -> MotionNotFound | TimeLimitReached:
    """The error that says why no motion was found.

    Args:
        sought: what was looked for.
        failures: of every attempt.
        strategies: that were tried, in turn.
    """
    tried = sorted(failures, key=lambda f: f.remaining)
    trees = [f.message for f in failures if f.candidate == TREES]
    held: tuple[str, ...] = ()
    if tried:
        best = tried[0]
        reason = (
            f"no motion found in {len(tried) - len(trees)} candidates; the best ({best.candidate}) ended with "
            f"{sought.ends_with} {short_length(best.remaining)} from the goal: {best.message}; tightest there: "
            f"{best.obstacle}"
        ) + "".join(f"; {ended}" for ended in trees if ended != best.message)
        joints, held = joints_at_limits(best.bends, sought.bend_limits)
        reason += f"; {joints}" if joints else ""
    else:
        reason = "no motion found: no route to the goal was found that the arm is thin and long enough for"
    reason += _limits_in_the_way(sought.constraints, tried)
    reason += _how_far(strategies)
    figures = {**evidence(tried), "strategies": [asdict(each) for each in strategies]}
    relaxed = ("relax the constraints, or make them soft",) if sought.constraints else ()
    what_held = (*relaxed, *held, *_way_made(tried), *room_advice(sought.radius, sought.clearance))
    if any(not each.exhausted for each in strategies):
        reason = f"{sought.deadline.what_passed()}: {reason}"
        advice = (*what_held, "raise planner.time_limit")
        return TimeLimitReached(Diagnosis(reason, "motion", advice, figures))
    advice = (*what_held, *sought.advice, *(() if held else ("raise arm.joint_limit_deg",)), "use a longer arm")
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
    """The constraint in the way of the candidate that came nearest, or all of them."""
    if not names:
        return ""
    met = [failure.limit for failure in tried if failure.limit]
    if met:
        return f"; {met[0]} where candidates ended ({len(met)} of {len(tried)} at a constraint)"
    return "; under " + ", ".join(f"constraint '{name}'" for name in names)
