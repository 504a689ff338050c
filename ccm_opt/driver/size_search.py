"""Search for one size of an arm: trials between values that have no plan and values that have one, and proofs."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from ccm_opt.core.errors import (
    Diagnosis,
    MotionNotFound,
    NoPlanFound,
    ProblemError,
    UnreachableGoal,
    VerificationError,
)
from ccm_opt.core.progress import Stages
from ccm_opt.diagnosis.ranking import no_axis_path_error, rank_findings
from ccm_opt.diagnosis.relaxation import with_short_limit
from ccm_opt.diagnosis.sizes import Proofs, Size
from ccm_opt.driver.pipeline import solve
from ccm_opt.driver.settings import DEFAULT_SETTINGS, Settings
from ccm_opt.driver.short_poses import Ends, has_short_pose, posed, short_poses, without_stops
from ccm_opt.driver.solution_assembly import described
from ccm_opt.driver.verified_plan import TermResults, VerifiedPlan, verified
from ccm_opt.dynamics.runtime.inverse_dynamics import InverseDynamics, joint_states
from ccm_opt.problem import Problem
from ccm_opt.problem.solution import Solution
from ccm_opt.problem.solution.sizes import ArmSize, SizeTrial, TrialOutcome

_SHARE = 0.01
"""Relative precision of a size: by so much the next smaller one that was tried differs. Heuristic."""
_PROOF_SHARE = 0.001
"""Relative precision of the border of what is proved. Heuristic: a proof takes a fraction of a trial."""
_SHORT = 0.2
"""Share of the time limit that a trial has until the border is reached. Heuristic."""
_AHEAD = (0.0, 0.25, 0.5, 1.0)
"""Where easier values are tried until one has a plan, as shares of the way to the easiest. Heuristic."""
_BEYOND_PROOF = 0.1
"""Where the first value is tried if the given one is proved impossible, as a share of the way. Heuristic."""
_PROOF_TIME = 8.0
"""CPU time limit of one proof [s]. Heuristic, like that of the search for ways in space."""
_GAP_KEPT = 0.999
"""Share of the clearance of a plan by which the arm is made thicker to verify the plan again. Heuristic."""


@dataclass(frozen=True)
class Attempt:
    """Result of a trial: the plan, or the reason why there is none and whether it is proved; with the CPU time [s]."""

    solution: Solution | None
    reason: str
    proved: bool
    cpu: float


def attempt(settings: Settings, problem: Problem) -> Attempt:
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
    return Attempt(solution, reason, proved, time.process_time() - begun)


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
class SizeSearch:
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
        ends: poses of the shortest arms that have a plan to them, by value.
    """

    problem: Problem
    size: Size
    limit: float
    run: Callable[[Sequence[Problem]], Sequence[Attempt]]
    tell: Callable[[str], None]
    width: int
    settings: Settings
    trials: list[SizeTrial]
    mount: float = 0.0
    easy: float = np.nan
    best: Solution | None = None
    best_is_long: bool = False
    failed: dict[float, SizeTrial] = field(default_factory=dict)
    ends: dict[float, Ends] = field(default_factory=dict)

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
        return self.proofs.easiest(self.easiest, _PROOF_SHARE)

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
        thicker = self.size.rounded(self.problem, value + _GAP_KEPT * room_to_grow(solution))
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

    def shorten(self) -> None:
        """Try the shortest arms that have a pose at the goal near that of the plan known, until one has a plan.

        Only for the length of an arm of equal links with one goal of the tip.
        """
        if self.best is None or self.size.name != "length" or not has_short_pose(self.problem):
            return
        tried = [each for each in short_poses(self.size, self.best) if each[0] not in self.failed]
        for first in range(0, len(tried), self.width):
            self._move_to(tried[first : first + self.width])
            if self.easy <= tried[first][0]:
                return

    def _move_to(self, ends: Sequence[tuple[float, Ends]], *, long: bool = False) -> None:
        """Solve the problem for several values, each with poses to which the motion leads, and keep the plans."""
        limit = self.limit if long else _SHORT * self.limit
        problems = [posed(self.at(value), poses) for value, poses in ends]
        if not long:
            problems = [with_short_limit(each, limit) for each in problems]
        for (value, poses), found in zip(ends, self.run(problems), strict=True):
            plan = found.solution and held(self.at(value), without_stops(found.solution), self.settings)
            if plan is None:
                why = found.reason or "the plan to the shortest arm's pose does not hold for the goal"
                record = SizeTrial.of(self.at(value), "not found", why, found.cpu, limit)
                self.failed.setdefault(value, record)
            else:
                record = SizeTrial.of(plan.problem, "verified", "", found.cpu, limit)
                self.failed.pop(value, None)
                self.ends[value] = poses
                self.keep(value, plan, long=long)
            self.trials.append(record)
            self.tell(f"{record.words(self.size.name)}: {record.outcome}")

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
            if self.easy in self.ends:
                self._move_to([(self.easy, self.ends[self.easy])], long=True)
            else:
                self.attempt([self.easy], long=True)
            self.failed.pop(self.easy, None)
        following = self.bound if self.hard == self.proved else self.failed.get(self.hard)
        return ArmSize(self.size.name, self.best, following, self.bound, tuple(trials), **places)


def room_to_grow(solution: Solution) -> float:
    """Return by how much the links of a plan could be thicker without contact [m]."""
    gaps = {check.name: check.worst - check.limit for check in solution.checks}
    # Links that are thicker by an amount come closer to each other by twice as much.
    return max(min(gaps.get("wall clearance", 0.0), 0.5 * gaps.get("self-collision", np.inf)), 0.0)
