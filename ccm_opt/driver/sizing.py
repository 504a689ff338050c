"""Search for the arm that is needed: least length, fewest links, greatest radius, best place of the base."""

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import BrokenExecutor, Executor
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import partial
from typing import get_args

import numpy as np

from ccm_opt.core.arguments import expect, expect_that, is_number
from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import (
    CancelledWithPlan,
    NoPlanFound,
    ProblemError,
    UnreachableGoal,
)
from ccm_opt.core.executors import LocalWorkers, ThisProcess, Workers, completed
from ccm_opt.core.length_words import words_in
from ccm_opt.core.progress import Progress
from ccm_opt.diagnosis.sizes import SIZES, size_of
from ccm_opt.driver.arguments import expect_arguments, expect_workers, refuse_free_order
from ccm_opt.driver.settings import DEFAULT_SETTINGS, Settings
from ccm_opt.driver.size_search import Attempt, SizeSearch, attempt, held
from ccm_opt.problem import Problem
from ccm_opt.problem.solution.sizes import ArmSize, SizeFront, SizeName, SizeTrial

_BETTER = 0.02
"""Share by which another place of the base, or another radius, must be better. Heuristic."""
_FRONT = (0.5, 0.75, 1.0, 1.25, 1.5)
"""Radii of the trade-off with the length, as multiples of the given one. Heuristic."""


@dataclass(frozen=True)
class _Sizing:
    """Arguments of a search that all places and radii share.

    Attributes:
        find: name of the size.
        limit: CPU time limit of a long trial [s]; None for that of the problem.
        workers: number of processes, or an object that opens an executor.
        progress: called with every report, or None.
        settings: settings of all stages of planning.
        processes: executor of the processes of this machine while they are kept; else empty.
    """

    find: SizeName
    limit: float | None
    workers: Workers | int
    progress: Callable[[Progress], None] | None
    settings: Settings
    processes: list[Executor] = field(default_factory=list)

    def search(self, problem: Problem, trials: list[SizeTrial], mount: float = 0.0) -> SizeSearch:
        """Return a search for the size of a problem's arm, whose trials are added to a list.

        Args:
            problem: the problem.
            trials: record of trials.
            mount: length of the mount for which proofs are to hold; 0 for that of the search [m].
        """
        size = size_of(problem, self.find)
        limit = problem.planner.time_limit if self.limit is None else self.limit
        width = self.workers if isinstance(self.workers, int) else 1 if isinstance(self.workers, ThisProcess) else 4
        return SizeSearch(problem, size, limit, self._run, self._tell, width, self.settings, trials, mount)

    @contextmanager
    def started(self) -> Iterator[None]:
        """Keep the processes of this machine, if several are used, until the end of a ``with`` block."""
        if not isinstance(self.workers, int) or self.workers == 1:
            yield
            return
        with LocalWorkers(self.workers).open() as (executor, _):
            self.processes.append(executor)
            yield

    def _run(self, problems: Sequence[Problem]) -> list[Attempt]:
        if self.processes:
            try:
                return list(self.processes[0].map(partial(attempt, self.settings), problems))
            except BrokenExecutor:
                self.processes.clear()  # from here on, new ones for every few trials
        crew = self.workers if not isinstance(self.workers, int) else ThisProcess()
        if isinstance(self.workers, int) and self.workers > 1:
            crew = LocalWorkers(min(self.workers, len(problems)))
        results: dict[int, Attempt] = {}
        for (number, _), found in completed(crew, partial(_numbered, self.settings), enumerate(problems)):
            if isinstance(found, BaseException):
                raise found
            results[number] = found
        return [results[number] for number in range(len(problems))]

    def _tell(self, words: str) -> None:
        if self.progress is not None:
            self.progress(Progress("sizes", name=words))


def _numbered(settings: Settings, task: tuple[int, Problem]) -> Attempt:
    """Return the result of a numbered trial."""
    return attempt(settings, task[1])


def size(
    problem: Problem,
    find: SizeName = "length",
    *,
    places: Sequence[Sequence[float]] | FloatArray | None = None,
    time_limit: float | None = None,
    workers: Workers | int = 1,
    progress: Callable[[Progress], None] | None = None,
    settings: Settings | None = None,
) -> ArmSize:
    """Return the arm that a problem needs: the least length, the fewest links or the greatest radius that is enough.

    Arms differ from the problem's in this size alone; lengths change with those of all links, in proportion. The search
    goes from twice the given length or number of links, or a quarter of the radius, to where it is proved that there is
    no plan. Between, it halves the interval by short trials, and tries the last value again with all time. That a plan
    was found for one size does not mean that there is one for all that are easier: what is returned is the hardest for
    which a plan was found, and whether the next one is proved impossible.

    Args:
        problem: the problem, planar or in space, with one goal or several.
        find: "length", "links" (of the given length) or "radius".
        places: places of the base among which the best is sought, shape (k, d) [m]; None for that of the problem.
        time_limit: CPU time limit of one plan [s]; short trials have a fifth. None for that of the problem.
        workers: number of processes on this machine, or an object that opens an executor, such as ``DaskWorkers``.
        progress: function called after every trial.
        settings: settings of all stages of planning; None for the defaults.

    Raises:
        ProblemError: the problem or an argument is invalid, or something in the problem is tied to the arm's size.
        NoPlanFound: no plan was found for any size; the error holds a diagnosis.
        CancelledWithPlan: Ctrl-C was pressed after a plan was found, which the error holds.
    """
    sizing = _sizing(problem, find, time_limit, workers, progress, settings)
    trials: list[SizeTrial] = []
    with words_in(problem.length_unit), sizing.started():
        if places is None:
            return _sized(sizing.search(problem, trials), trials)
        return _best_placed(sizing, problem, _places(problem, places), trials)


def _sizing(
    problem: Problem,
    find: SizeName,
    time_limit: float | None,
    workers: Workers | int,
    progress: Callable[[Progress], None] | None,
    settings: Settings | None,
) -> _Sizing:
    """Return the shared arguments of a search, after checking them; arguments and errors are those of ``size``."""
    Problem.expected(problem)
    expect_arguments(progress=progress, settings=settings)
    expect_that(lambda: find in get_args(SizeName), find, f"one of {', '.join(SIZES)} for find=")
    expect_that(
        lambda: time_limit is None or (is_number(time_limit) and time_limit > 0.0),
        time_limit,
        "a CPU time above 0 [s] for time_limit=",
    )
    expect_workers(workers)
    size_of(problem, find)
    refuse_free_order(problem, "sizes of an arm are")
    return _Sizing(find, time_limit, workers, progress, settings or DEFAULT_SETTINGS)


def _places(problem: Problem, places: Sequence[Sequence[float]] | FloatArray) -> FloatArray:
    """Return places of the base as an array (k, d) [m], after checking them."""
    expect(places, (list, tuple, np.ndarray), "a list of points for places=")
    try:
        given = np.asarray(places, dtype=float)
    except (TypeError, ValueError):
        given = np.zeros(0)
    d = problem.dimension
    if given.ndim != 2 or given.shape[1] != d or not len(given) or not np.all(np.isfinite(given)):
        raise ProblemError(f"places must be an array of shape (k, {d}) of finite numbers, got shape {given.shape}")
    if any(getattr(goal, "curve", None) for goal in (problem.start, *(stop.goal for stop in problem.goals))):
        raise ProblemError("start or goal is given by segments, which begin at the base; the base cannot be moved")
    return given


def _sized(search: SizeSearch, trials: Sequence[SizeTrial], **places: int) -> ArmSize:
    """Return the size that a search finds.

    Raises:
        NoPlanFound: there is none.
        CancelledWithPlan: Ctrl-C was pressed after a plan was found.
    """
    try:
        if search.best is None:
            search.begin()
            search.shorten()
            search.narrow()
        search.shorten()
        search.confirm()
        return search.result(trials, **places)
    except KeyboardInterrupt as interrupt:
        if search.best is None:
            raise
        raise CancelledWithPlan(search.best) from interrupt


def _best_placed(sizing: _Sizing, problem: Problem, places: FloatArray, trials: list[SizeTrial]) -> ArmSize:
    """Return the best size over several places of the base.

    The place with the best bound comes first. Every other is searched only if its bound leaves room for a better size.

    Raises:
        NoPlanFound: no plan was found at any place; the error is that of the most promising.
    """
    searches: list[SizeSearch] = []
    failures: list[NoPlanFound] = []
    for place in places:
        search = sizing.search(replace(problem, arm=replace(problem.arm, base=place), source=""), trials)
        try:
            search.proved  # noqa: B018 - proofs are made here, and kept
        except UnreachableGoal as failure:
            trials.append(SizeTrial.of(search.at(search.easiest), "impossible", failure.diagnosis.reason))
            failures.append(failure)
        else:
            searches.append(search)
    proved = len(failures)
    searches.sort(key=lambda each: each.size.parameter.easier * (each.hardest if each.proved is None else each.proved))
    best: SizeSearch | None = None
    for search in searches:
        if best is None:
            try:
                search.begin()
                search.narrow(_BETTER)
            except NoPlanFound as failure:
                failures.append(failure)
                continue
            best = search
            continue
        better = search.size.rounded(
            problem, best.easy * (1.0 - _BETTER * search.size.parameter.easier) - search.size.step
        )
        if search.proved is not None and not search.size.harder(search.proved, better):
            proved += 1
            continue
        search.attempt([better])
        if search.best is not None:
            search.narrow(_BETTER)
            best = search
    if best is None:
        raise failures[-1]
    best.narrow()
    return _sized(best, trials, places=len(places), places_proved=proved)


def size_front(
    problem: Problem,
    *,
    time_limit: float | None = None,
    workers: Workers | int = 1,
    progress: Callable[[Progress], None] | None = None,
    settings: Settings | None = None,
) -> SizeFront:
    """Return the least length that is enough for each of several radii, from half the given one to half as much again.

    Thick arms come first. The plan of a thicker arm is verified for the next thinner one, of the same length, and the
    search goes on below. Arguments and errors are those of ``size``.

    Raises:
        ProblemError: the problem or an argument is invalid, or something in the problem is tied to the arm's size.
        NoPlanFound: no plan was found for any radius; the error is that of the thinnest.
    """
    sizing = _sizing(problem, "length", time_limit, workers, progress, settings)
    radius = size_of(problem, "radius")
    trials: list[SizeTrial] = []
    found: dict[float, tuple[ArmSize | None, SizeTrial | None, str]] = {}
    thicker: SizeSearch | None = None
    last: NoPlanFound | None = None
    # A proof for one radius holds for the thicker arms of the front, with their longer mounts.
    mount = radius.at(problem, _FRONT[-1] * problem.arm.radius).arm.mount_length
    with words_in(problem.length_unit), sizing.started():
        for share in reversed(_FRONT):
            value = radius.rounded(problem, share * problem.arm.radius)
            search = sizing.search(radius.at(problem, value), trials, mount)
            bound: SizeTrial | None = None
            try:
                bound = search.bound
                if thicker is not None and thicker.best is not None:
                    same = held(search.at(thicker.easy), thicker.best, sizing.settings)
                    if same is not None:
                        trials.append(SizeTrial.of(same.problem, "verified"))
                        search.keep(thicker.easy, same, long=False)
                if search.best is None:
                    search.begin()
                search.narrow(_BETTER)
                size = search.result(trials)
                found[value] = (size, bound, "")
                thicker = search
            except UnreachableGoal as failure:
                # Proved for all lengths within the search.
                closed = SizeTrial.of(search.at(search.easiest), "impossible", failure.diagnosis.reason)
                trials.append(closed)
                found[value] = (None, closed, failure.diagnosis.reason)
                last = failure
            except NoPlanFound as failure:
                found[value] = (None, bound, failure.diagnosis.reason)
                last = failure
    radii = tuple(sorted(found))
    sizes, bounds, reasons = zip(*(found[value] for value in radii), strict=True)
    if last is not None and not any(sizes):
        raise last
    return SizeFront(problem, radii, sizes, bounds, reasons, tuple(trials))
