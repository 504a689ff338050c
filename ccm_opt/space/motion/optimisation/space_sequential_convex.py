"""Sequential convex programming over all keyframes of a motion in space; every iterate is certified.

A step that the certificate refuses is shortened, then damped, and what an interval lacks becomes dearer; so the motion
stays in its homotopy class, and the last iterate is always fit for use.
"""

from dataclasses import dataclass, field, replace

import numpy as np

from ccm_opt.ground.arrays import FloatArray, IntArray
from ccm_opt.space.motion.optimisation.cost import SpaceMotionCost
from ccm_opt.space.motion.optimisation.keyframe_rows import KeyframeRows
from ccm_opt.space.motion.optimisation.passing_keyframes import PassingKeyframes
from ccm_opt.space.motion.optimisation.program import SpaceKeyframeProgram, SpaceQuadraticStep
from ccm_opt.space.motion.optimisation.rows import SpaceRows, motion_rows, room_lacking, tightest
from ccm_opt.space.motion.optimisation.space_sweep import SpaceSweep
from ccm_opt.space.motion.optimisation.user_keyframes import CostWithTerms, UserKeyframes
from ccm_opt.space.motion.pieces import failing_edges
from ccm_opt.space.motion.settings.space_optimisation_settings import SpaceOptimisationSettings
from ccm_opt.space.motion.space_goal import onto_goal
from ccm_opt.space.motion.space_step import SpaceStepper
from ccm_opt.space.motion.task import SpaceTask


@dataclass(frozen=True, eq=False)
class _Iterate:
    """Where the iteration is.

    Attributes:
        sweep: the motion, certified.
        rows: what it has to keep, drawn about it.
        lack: of room, of all intervals together [u].
        merit: its cost and what it lacks at the first price.
        damping: of the next step.
        prices: of slack in each interval, shape (K,).
    """

    sweep: SpaceSweep
    rows: SpaceRows
    lack: float
    merit: float
    damping: float
    prices: FloatArray


@dataclass(eq=False)
class SequentialConvex:
    """Optimises a certified motion.

    Args:
        task: what the motion is for.
        stepper: of its unknowns.
        end_fixed: whether the last keyframe has to stay.
        terms: the user's, over the keyframes; None where there are none.
        passing: keyframes at which the tip passes places; None where it need not.
    """

    task: SpaceTask
    stepper: SpaceStepper
    end_fixed: bool
    terms: UserKeyframes | None = None
    passing: PassingKeyframes | None = None
    _cost: SpaceMotionCost | CostWithTerms = field(init=False)

    def __post_init__(self) -> None:
        settings = self.task.settings
        plain = SpaceMotionCost(self.task.slowness, settings.objective)
        self._cost = plain if self.terms is None else CostWithTerms(plain, self.terms)

    @property
    def _settings(self) -> SpaceOptimisationSettings:
        return self.task.settings.optimisation

    def optimised(self, unknowns: FloatArray, rounds: int) -> FloatArray:
        """The unknowns of a better motion, shape (K + 1, p), certified; the same where none is found.

        Args:
            unknowns: at the keyframes, shape (K + 1, p); certified.
            rounds: most steps.
        """
        settings = self._settings
        sweep = SpaceSweep(self.stepper, unknowns)
        iterate = self._iterate(sweep, settings.first_damping, np.full(sweep.intervals, settings.price))
        best = iterate
        idle = 0
        for _ in range(rounds):
            following = self._round(iterate)
            if following is None:
                break
            idle = idle + 1 if following.merit > (1.0 - settings.worth) * best.merit else 0
            if following.merit < best.merit:
                best = following
                iterate = following
            else:
                # The rows did not foresee what came of the step: a shorter one.
                damping = settings.refused_growth * max(following.damping, settings.raised_damping)
                iterate = replace(best, damping=damping, prices=following.prices)
            patience = settings.patience if best.lack <= 0.0 else settings.patience_in_want
            if idle >= patience or self.task.deadline.passed():
                break
        return best.sweep.unknowns

    def _iterate(self, sweep: SpaceSweep, damping: float, prices: FloatArray) -> _Iterate:
        """A motion with its rows: what its steps did not foresee counts in its merit."""
        settings = self._settings
        rows = motion_rows(sweep, self.task.wanted_gap, settings.margin * self.task.unit, settings)
        lack = float(np.sum(room_lacking(sweep, self.task.wanted_gap, settings))) / self.task.unit
        merit = self._cost.value(sweep) + settings.price * lack
        return _Iterate(sweep, rows, lack, merit, damping, prices)

    def _round(self, iterate: _Iterate) -> _Iterate | None:
        """One accepted step, or None when none is."""
        settings = self._settings
        task = self.task
        sweep = iterate.sweep
        rows = iterate.rows
        values = rows.values(sweep)
        near = np.flatnonzero(values > -settings.active * task.unit)
        group = max(1, -(-task.arm.links // settings.groups))
        active = rows.take(near).take(tightest(rows.take(near), values[near], group))
        goal = None if self.end_fixed else task.goal
        held = self._held_rows(sweep)
        for _ in range(settings.tries):
            program = SpaceKeyframeProgram(
                sweep, self._cost, active, iterate.prices, iterate.damping, goal, settings, held
            )
            step = program.solve()
            following = None
            failing = np.zeros(0, dtype=np.intp)
            if step is not None:
                following, failing = self._part_taken(iterate, step)
            if following is not None:
                return following
            if task.deadline.passed():
                return None
            prices = iterate.prices.copy()
            prices[failing] *= settings.price_rise
            damping = settings.refused_growth * max(iterate.damping, settings.raised_damping)
            iterate = replace(iterate, damping=damping, prices=prices)
        return None

    def _part_taken(self, iterate: _Iterate, step: SpaceQuadraticStep) -> tuple[_Iterate | None, IntArray]:
        """The longest part of a step that gains what was foreseen and is certified, and where longer ones failed."""
        settings = self._settings
        start = iterate.sweep
        rows = iterate.rows
        failed = np.zeros(0, dtype=np.intp)
        cost = self._cost.value(start)
        worst = self._worst(rows, start)
        before = cost + float(iterate.prices @ worst)
        foreseen = step.foreseen + float(iterate.prices @ (worst - step.slack))
        for share in settings.shortenings:
            unknowns = self._ended(start.unknowns + share * step.change)
            if unknowns is None:
                continue
            if self.terms is not None:
                unknowns = self.terms.restored(self.stepper, unknowns)
            sweep = SpaceSweep(self.stepper, unknowns)
            if not self._holds(sweep):
                continue
            after = self._cost.value(sweep)
            worst_after = self._worst(rows, sweep)
            gain = (before - after - float(iterate.prices @ worst_after)) / max(share * foreseen, 1e-12)
            # Negated, so that a gain that is not a number is refused.
            if not gain > settings.sufficient or not all(self.stepper.within_limits(q) for q in sweep.configurations):
                continue
            failing = failing_edges(self.stepper, unknowns)
            if len(failing) == 0:
                prices = iterate.prices.copy()
                prices[failed] *= settings.price_rise
                lacking = worst_after * self.task.unit > settings.lack * self.task.wanted_gap
                prices[lacking] = np.minimum(settings.lack_rise * prices[lacking], settings.highest_price)
                return self._iterate(sweep, self._damped(iterate.damping, share, gain), prices), failed
            failed = failing
        return None, failed

    def _held_rows(self, sweep: SpaceSweep) -> KeyframeRows | None:
        """What single keyframes have to keep, by the user's terms and by the places that the tip passes."""
        return KeyframeRows.joined([part.rows(sweep) for part in (self.terms, self.passing) if part is not None])

    def _holds(self, sweep: SpaceSweep) -> bool:
        """Whether the keyframes of a motion keep that."""
        return all(part.holds(sweep) for part in (self.terms, self.passing) if part is not None)

    def _worst(self, rows: SpaceRows, sweep: SpaceSweep) -> FloatArray:
        """By how much the worst row of every interval is not kept, at least 0, in nominal links, shape (K,)."""
        worst = np.zeros(sweep.intervals)
        # Rows at the given start can never be mended.
        free = rows.free
        np.maximum.at(worst, rows.interval[free], rows.values(sweep)[free] / self.task.unit)
        return worst

    def _ended(self, unknowns: FloatArray) -> FloatArray | None:
        """The motion with its last keyframe exactly on the goal; None where that fails."""
        if self.end_fixed or self.task.goal is None:
            return unknowns
        last = self.stepper.pose(unknowns[-1])
        onto = onto_goal(self.stepper, self.task.goal, last)
        if onto is None:
            return unknowns if self.task.goal.met(last) else None
        return np.vstack((unknowns[:-1], onto.v))

    def _damped(self, damping: float, share: float, gain: float) -> float:
        """More damping after a shortened step, less after a good one."""
        settings = self._settings
        if share < 1.0:
            return max(damping, settings.raised_damping) * settings.shortened_growth
        if gain > settings.good:
            return max(damping / settings.good_shrinkage, settings.least_damping)
        return damping
