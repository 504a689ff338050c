"""Inverse kinematics of the tip: coordinates that put it at a place, pointing where it should, within the limits."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ccm_opt.ground.arrays import BoolArray, FloatArray
from ccm_opt.ground.small_qp import solve_small_qp
from ccm_opt.space.curve.chain_state import ChainState
from ccm_opt.space.curve.curve_space import CurveSpace, chain_at
from ccm_opt.space.curve.inverse_settings import DEFAULT_TIP_NEWTON, TipNewtonSettings
from ccm_opt.space.curve.tip_target import TipTarget


@dataclass(frozen=True)
class TipSolution:
    """Where inverse kinematics got.

    Attributes:
        v: coordinates, shape (p,).
        q: the configuration, within the limits, shape (c,) [rad, m].
        position_error: distance of the tip from its place [m].
        direction_error: angle of the last link to its direction [rad]; 0 where none is asked for.
        steps: Newton steps that were tried.
        met: whether tip and direction are there but for rounding.
    """

    v: FloatArray
    q: FloatArray
    position_error: float
    direction_error: float
    steps: int
    met: bool


@dataclass(frozen=True)
class TipNewton:
    """Levenberg and Marquardt's method with limits: min |J δ − e|² + μ |δ|² within them, μ falling with |e|².

    Attributes:
        space: in whose coordinates the arm moves, a few of a curve or all bends.
        lower: least value of every coordinate of the arm, shape (c,) [rad, m].
        upper: greatest value, likewise; where both are the same the coordinate is held.
        settings: of the steps.
    """

    space: CurveSpace
    lower: FloatArray
    upper: FloatArray
    settings: TipNewtonSettings = DEFAULT_TIP_NEWTON

    @classmethod
    def within_limits(cls, space: CurveSpace, settings: TipNewtonSettings = DEFAULT_TIP_NEWTON) -> "TipNewton":
        """Within the limits of the arm, whose guide tube holds nothing."""
        return cls(space, space.arm.lower_limits, space.arm.upper_limits, settings)

    def solve(self, start: FloatArray, target: TipTarget) -> TipSolution:
        """Bring the tip to a target from coordinates of shape (p,), which have to be within the limits."""
        settings = self.settings
        v = start
        state = chain_at(self.space, v)
        error, rows = target.errors(state, self._length_unit)
        damping = settings.damping
        steps = 0
        while steps < settings.most_steps and damping < settings.most_damping:
            if float(np.linalg.norm(error)) <= settings.settled:
                break
            steps += 1
            trial = v + self._step(state, error, rows, damping)
            ahead = chain_at(self.space, trial)
            error_ahead, rows_ahead = target.errors(ahead, self._length_unit)
            if not np.linalg.norm(error_ahead) < np.linalg.norm(error):
                damping *= settings.stiffened
                continue
            damping *= settings.relaxed
            v = trial
            state = ahead
            error = error_ahead
            rows = rows_ahead
        return self._solution(v, state, target, steps)

    @cached_property
    def _length_unit(self) -> float:
        return self.settings.length_unit * self.space.arm.length

    @cached_property
    def _held(self) -> BoolArray:
        """Which coordinates of the arm are held, shape (c,)."""
        return np.asarray(self.upper <= self.lower)

    @cached_property
    def _free(self) -> FloatArray:
        """Directions of v in which nothing moves that is held, as orthonormal columns, shape (p, f)."""
        if not self._held.any():
            return np.eye(self.space.dimension)
        _, values, directions = np.linalg.svd(self.space.matrix[self._held])
        rank = int(np.sum(values > self.settings.at_limit))
        return np.asarray(directions[rank:].T)

    @cached_property
    def _moved(self) -> FloatArray:
        """By how much the coordinates that are not held change with these directions, shape (c − held, f)."""
        return np.ascontiguousarray(self.space.matrix[~self._held] @ self._free)

    def _step(self, state: ChainState, error: FloatArray, rows: FloatArray, damping: float) -> FloatArray:
        """The step, shortened where it turns a joint too much."""
        weight = damping * float(error @ error)
        # Least-norm form: only as many equations as the target has.
        freely = rows @ self._free
        inner = freely @ freely.T
        inner += (weight + self.settings.singular * float(np.trace(inner))) * np.eye(len(rows))
        step = self._shortened(self._free @ (freely.T @ np.linalg.solve(inner, error)))
        ahead = state.q + self.space.matrix @ step
        slack = self.settings.at_limit
        if np.all((ahead <= self.upper + slack) & (ahead >= self.lower - slack)):
            return step
        return self._shortened(self._limited_step(state, error, freely, weight))

    def _limited_step(self, state: ChainState, error: FloatArray, freely: FloatArray, weight: float) -> FloatArray:
        """The same where limits count."""
        hessian = freely.T @ freely
        hessian[np.diag_indices_from(hessian)] += weight + self.settings.singular * float(np.trace(hessian))
        inset = self.settings.inset
        # What is at its limit has to come off it by that much: the solver keeps rows to a millionth only.
        least = (self.lower - state.q + inset)[~self._held]
        most = (self.upper - state.q - inset)[~self._held]
        senses = np.zeros(len(most), dtype=np.intc)
        step = solve_small_qp(hessian, -freely.T @ error, self._moved, most, least, senses)
        return np.zeros(self.space.dimension) if step is None else self._free @ step

    def _shortened(self, step: FloatArray) -> FloatArray:
        turns = self.space.matrix[: 2 * self.space.arm.links] @ step
        largest = float(np.max(np.abs(turns), initial=0.0))
        return step * min(1.0, self.settings.most_turn / max(largest, self.settings.at_limit))

    def _solution(self, v: FloatArray, state: ChainState, target: TipTarget, steps: int) -> TipSolution:
        distance = float(np.linalg.norm(target.position - state.positions[-1]))
        angle = target.angle(state.rotations[-1, :, 0])
        error, _ = target.errors(state, self._length_unit)
        q = np.clip(state.q, self.lower, self.upper)
        inside = bool(np.all(np.abs(state.q - q) <= self.settings.at_limit))
        # What is just above it may be as good as rounding lets it be.
        met = inside and float(np.linalg.norm(error)) <= 1e2 * self.settings.settled
        return TipSolution(v, q, distance, angle, steps, met)
