"""Search for the arm that is needed: least length, fewest links, greatest radius, best place of the base."""

import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import BrokenExecutor, Executor
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import get_args

import numpy as np

from ccm_opt.core.arguments import expect, expect_that, is_number
from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import (
    CancelledWithPlan,
    Diagnosis,
    MotionNotFound,
    NoPlanFound,
    ProblemError,
    UnreachableGoal,
    VerificationError,
)
from ccm_opt.core.executors import LocalWorkers, ThisProcess, Workers, completed
from ccm_opt.core.length_words import words_in
from ccm_opt.core.progress import Progress, Stages
from ccm_opt.diagnosis.ranking import no_axis_path_error, rank_findings
from ccm_opt.diagnosis.relaxation import with_short_limit
from ccm_opt.diagnosis.sizes import SIZES, Proofs, Size, size_of
from ccm_opt.driver.arguments import expect_arguments, expect_workers, refuse_free_order
from ccm_opt.driver.pipeline import solve
from ccm_opt.driver.settings import DEFAULT_SETTINGS, Settings
from ccm_opt.driver.solution_assembly import described
from ccm_opt.driver.verified_plan import TermResults, VerifiedPlan, verified
from ccm_opt.dynamics.runtime.inverse_dynamics import InverseDynamics, joint_states
from ccm_opt.problem import Problem
from ccm_opt.problem.solution import Solution
from ccm_opt.problem.solution.sizes import ArmSize, SizeFront, SizeName, SizeTrial, TrialOutcome

_SHARE = 0.01
"""Relative precision of a size: by so much the next smaller one that was tried differs. Heuristic."""
_BETTER = 0.02
"""Share by which another place of the base, or another radius, must be better. Heuristic."""
_SHORT = 0.2
"""Share of the time limit that a trial has until the border is reached. Heuristic."""
_AHEAD = (0.0, 0.25, 0.5, 1.0)
"""Where easier values are tried until one has a plan, as shares of the way to the easiest. Heuristic."""
_BEYOND_PROOF = 0.1
"""Where the first value is tried if the given one is proved impossible, as a share of the way. Heuristic."""
_PROOF_TIME = 8.0
"""CPU time limit of one proof [s]. Heuristic, like that of the search for ways in space."""
_FRONT = (0.5, 0.75, 1.0, 1.25, 1.5)
"""Radii of the trade-off with the length, as multiples of the given one. Heuristic."""
_GAP_KEPT = 0.999
"""Share of the clearance of a plan by which the arm is made thicker to verify the plan again. Heuristic."""


@dataclass(frozen=True)
class _Attempt:
    """Result of a trial: the plan, or the reason why there is none and whether it is proved; with the CPU time [s]."""

    solution: Solution | None
    reason: str
    proved: bool
    cpu: float


def attempt(settings: Settings, problem: Problem) -> _Attempt:
    """Return the result of solving a problem within its time limit."""
    begun = time.process_time()
    solution, reason, proved = None, "", False
    try:
        solution = solve(problem, explain=False, settings=settings)
    except NoPlanFound as error:
        reason, proved = error.diagnosis.reason, error.diagnosis.proved
    except VerificationError as error:
        reason = "the verifier rejects the plan: " + "; ".join(error.failures)
    except ProblemError as error:
        reason = str(error)
    return _Attempt(solution, reason, proved, time.process_time() - begun)


def held(problem: Problem, solution: Solution, settings: Settings = DEFAULT_SETTINGS) -> Solution | None:
    """Return a plan of one arm as that of another with the same links; None if the verifier rejects it.

    Args:
        problem: problem that differs in the arm's radius.
        solution: plan of the other arm.
        settings: settings of all stages of planning.
    """
    trajectory = solution.trajectory
    joints = joint_states(problem.arm, trajectory, InverseDynamics(problem.arm, problem.simulation.gravity))
    try:
        checks = verified(problem, trajectory, joints, settings.verification)
    except VerificationError:
        return None
    # The spare was certified for the other arm and does not carry over.
    path = replace(solution.path, spare=0.0)
    return described(problem, VerifiedPlan(path, trajectory, joints, checks, TermResults()), Stages(), settings)


@dataclass
class _Search:
    """Search for one size of an arm at one place, between what is proved impossible and what has a plan.

    Attributes:
        problem: the problem, with the arm at its place.
        size: the size.
        limit: CPU time limit of a long trial [s].
        run: runs trials of problems, and yields each with its result.
        tell: called with text for the last trial.
        width: number of trials at a time.
        settings: settings of all stages of planning.
        trials: record of all trials.
        mount: length of the mount of the thickest arm for which proofs are to hold; 0 for that of the search [m].
        easy: hardest value with a plan; not a number until one is known.
        best: the plan.
        best_is_long: whether the plan was found with the problem's own options.
        failed: records of the values without a plan, by value.
    """

    problem: Problem
    size: Size
    limit: float
    run: Callable[[Sequence[Problem]], Sequence[_Attempt]]
    tell: Callable[[str], None]
    width: int
    settings: Settings
    trials: list[SizeTrial]
    mount: float = 0.0
    easy: float = np.nan
    best: Solution | None = None
    best_is_long: bool = False
    failed: dict[float, SizeTrial] = field(default_factory=dict)

    @property
    def given(self) -> float:
        """Value in the problem."""
        return self.size.parameter.read(self.problem)

    def at(self, value: float) -> Problem:
        """Return the problem with another value."""
        return self.size.at(self.problem, value)

    def words(self, value: float) -> str:
        """Return text for a value, with its unit."""
        return SizeTrial.of(self.at(value), "not found").words(self.size.name)

    @cached_property
    def hardest(self) -> float:
        """Value beyond which no harder one is tried."""
        return self.size.farthest(self.problem, self.size.hardest)

    @cached_property
    def easiest(self) -> float:
        """Value beyond which no easier one is tried."""
        return self.size.farthest(self.problem, self.size.nearest)

    @cached_property
    def proofs(self) -> Proofs:
        """Proofs for values and all beyond them."""
        mount = max(self.mount, self.at(self.hardest).arm.mount_length)
        return Proofs(self.problem, self.size, self.hardest, mount, _PROOF_TIME)

    @cached_property
    def proved(self) -> float | None:
        """Easiest value for which it is proved that there is no plan, nor for any beyond; None without a proof.

        Raises:
            UnreachableGoal: it is proved for all values.
        """
        self.tell("proofs")
        if self.proofs.holds(self.easiest)[0]:
            most = self.words(self.easiest)
            findings = rank_findings(self.proofs.findings(self.easiest))
            why = findings[0].reason if findings else no_axis_path_error(self.at(self.easiest)).diagnosis.reason
            raise UnreachableGoal(Diagnosis(f"even {most} {self.size.beyond}: {why}", "sizes", findings=findings))
        return self.proofs.easiest(self.easiest, 0.5 * _SHARE)

    @cached_property
    def bound(self) -> SizeTrial | None:
        """Record of the easiest value that is proved impossible, with the reason; None without a proof."""
        if self.proved is None:
            return None
        changed = self.at(self.proved)
        findings = rank_findings(self.proofs.findings(self.proved))
        reason = findings[0].reason if findings else no_axis_path_error(changed).diagnosis.reason
        return SizeTrial.of(changed, "impossible", reason)

    @property
    def hard(self) -> float:
        """Easiest value, beyond that of the plan, without a plan; or the hardest that may be tried."""
        known = [each for each in self.failed if self.size.harder(each, self.easy)]
        known.append(self.hardest if self.proved is None else self.proved)
        return max(known, key=lambda each: self.size.parameter.easier * each)

    def attempt(self, values: Sequence[float], *, long: bool = False) -> None:
        """Solve the problem for several values and keep the plan of the hardest."""
        limit = self.limit if long else _SHORT * self.limit
        options = replace(self.problem.planner, time_limit=limit)
        problems = [
            replace(changed, planner=options) if long else with_short_limit(changed, limit)
            for changed in map(self.at, values)
        ]
        for value, problem, found in zip(values, problems, self.run(problems), strict=True):
            if found.solution is None:
                outcome: TrialOutcome = "impossible" if found.proved else "not found"
                record = SizeTrial.of(problem, outcome, found.reason, found.cpu, limit)
                self.failed[value] = record
            else:
                record = SizeTrial.of(problem, "verified", "", found.cpu, limit)
                self.failed.pop(value, None)
                self.keep(value, found.solution, long=long)
            self.trials.append(record)
            self.tell(f"{record.words(self.size.name)}: {record.outcome}")

    def keep(self, value: float, solution: Solution, *, long: bool) -> None:
        """Keep a plan if its value is harder than that of the plan known, and verify it for a thicker arm."""
        if self.best is not None and not self.size.harder(value, self.easy) and not (long and value == self.easy):
            return
        self.easy, self.best, self.best_is_long = value, solution, long
        thicker = self.size.rounded(self.problem, value + _GAP_KEPT * _room_to_grow(solution))
        if self.size.harder(thicker, self.hardest):
            thicker = self.hardest
        if self.size.name != "radius" or not self.size.harder(thicker, value):
            return
        again = held(self.at(thicker), solution, self.settings)
        if again is not None:
            self.trials.append(SizeTrial.of(again.problem, "verified"))
            self.easy, self.best, self.best_is_long = thicker, again, False

    def begin(self) -> None:
        """Find a first plan, at the given value or at an easier one.

        Raises:
            NoPlanFound: no plan was found.
        """
        proved = self.proved
        first = self.given
        if proved is not None and not self.size.harder(proved, first):
            first = proved + _BEYOND_PROOF * (self.easiest - proved)
        values = [self.size.rounded(self.problem, first + share * (self.easiest - first)) for share in _AHEAD]
        values = list(dict.fromkeys(values))
        for long in (False, True):
            for value in values:
                self.attempt([value], long=long)
                if self.best is not None:
                    return
        last = self.failed[values[-1]]
        words = " and ".join(self.words(value) for value in (values[0], values[-1]))
        reason = f"no plan was found between {words}, each trial within {self.limit:.3g} s: {last.reason}"
        raise MotionNotFound(Diagnosis(reason, "sizes"))

    def narrow(self, share: float = _SHARE, *, long: bool = False) -> None:
        """Halve the interval between the plan and what has none, until it is narrow; by short trials, or long ones."""
        while self.size.harder(self.hard, self.easy) and not self.size.close(self.easy, self.hard, share):
            hard = self.hard
            parts = np.arange(1, self.width + 1) / (self.width + 1)
            values = [self.size.rounded(self.problem, float(self.easy + part * (hard - self.easy))) for part in parts]
            known = {*self.failed, self.easy, hard}
            fresh = [each for each in dict.fromkeys(values) if each not in known]
            if not fresh:
                return
            self.attempt(fresh, long=long)

    def confirm(self) -> None:
        """Try the next value with all time; if there is a plan, search again with all time for every value."""
        following = self.hard
        known = self.failed.get(following)
        if following in {self.proved, self.easy} or (known is not None and known.outcome == "impossible"):
            return
        self.attempt([following], long=True)
        if self.easy == following or self.size.harder(self.easy, following):
            self.failed = {value: each for value, each in self.failed.items() if each.outcome == "impossible"}
            self.narrow(long=True)

    def result(self, trials: Sequence[SizeTrial], **places: int) -> ArmSize:
        """Return the size, with a plan made anew with the problem's own options where that succeeds."""
        assert self.best is not None  # noqa: S101 - said by who asks
        if not self.best_is_long:
            self.attempt([self.easy], long=True)
            self.failed.pop(self.easy, None)
        following = self.bound if self.hard == self.proved else self.failed.get(self.hard)
        return ArmSize(self.size.name, self.best, following, self.bound, tuple(trials), **places)


def _room_to_grow(solution: Solution) -> float:
    """Return by how much the links of a plan could be thicker without contact [m]."""
    gaps = {check.name: check.worst - check.limit for check in solution.checks}
    # Links that are thicker by an amount come closer to each other by twice as much.
    return max(min(gaps.get("wall clearance", 0.0), 0.5 * gaps.get("self-collision", np.inf)), 0.0)


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

    def search(self, problem: Problem, trials: list[SizeTrial], mount: float = 0.0) -> _Search:
        """Return a search for the size of a problem's arm, whose trials are added to a list.

        Args:
            problem: the problem.
            trials: record of trials.
            mount: length of the mount for which proofs are to hold; 0 for that of the search [m].
        """
        size = size_of(problem, self.find)
        limit = problem.planner.time_limit if self.limit is None else self.limit
        width = self.workers if isinstance(self.workers, int) else 1 if isinstance(self.workers, ThisProcess) else 4
        return _Search(problem, size, limit, self._run, self._tell, width, self.settings, trials, mount)

    @contextmanager
    def started(self) -> Iterator[None]:
        """Keep the processes of this machine, if several are used, until the end of a ``with`` block."""
        if not isinstance(self.workers, int) or self.workers == 1:
            yield
            return
        with LocalWorkers(self.workers).open() as (executor, _):
            self.processes.append(executor)
            yield

    def _run(self, problems: Sequence[Problem]) -> list[_Attempt]:
        if self.processes:
            try:
                return list(self.processes[0].map(partial(attempt, self.settings), problems))
            except BrokenExecutor:
                self.processes.clear()  # from here on, new ones for every few trials
        crew = self.workers if not isinstance(self.workers, int) else ThisProcess()
        if isinstance(self.workers, int) and self.workers > 1:
            crew = LocalWorkers(min(self.workers, len(problems)))
        results: dict[int, _Attempt] = {}
        for (number, _), found in completed(crew, partial(_numbered, self.settings), enumerate(problems)):
            if isinstance(found, BaseException):
                raise found
            results[number] = found
        return [results[number] for number in range(len(problems))]

    def _tell(self, words: str) -> None:
        if self.progress is not None:
            self.progress(Progress("sizes", name=words))


def _numbered(settings: Settings, task: tuple[int, Problem]) -> _Attempt:
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


def _sized(search: _Search, trials: Sequence[SizeTrial], **places: int) -> ArmSize:
    """Return the size that a search finds.

    Raises:
        NoPlanFound: there is none.
        CancelledWithPlan: Ctrl-C was pressed after a plan was found.
    """
    try:
        if search.best is None:
            search.begin()
            search.narrow()
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
    searches: list[_Search] = []
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
    best: _Search | None = None
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
    thicker: _Search | None = None
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
