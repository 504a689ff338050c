"""Newton's method for a curve whose tip is asked for."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ccm_opt.core.arrays import BoolArray, FloatArray
from ccm_opt.core.small_qp import solve_small_qp
from ccm_opt.robot.curve_space import ChainState, CurveSpace, chain_at


@dataclass(frozen=True)
class TipNewtonSettings:
    """How an arm is brought to a place of its tip by damped Newton steps.

    Attributes:
        most_steps: Newton steps at most. Taste, five times what is usual.
        length_unit: share of the arm's length that counts as much as one radian of the tip's direction. Derived: a
            nominal link, of which there are 24.
        settled: error of the tip, in these units, at which it is there. Derived: what rounding leaves, ten times.
        most_turn: most that a bend changes in a step [rad]; keeps steps where their linear model means something.
            Taste.
        damping: first weight of the step's length against the squared error, as a share of that error. Taste.
        relaxed: factor on the damping after a step that came nearer. Taste, usual in Levenberg and Marquardt's method.
        stiffened: factor on it after one that did not. Likewise.
        most_damping: damping at which it gives up. Taste.
        inset: how far inside its limit a coordinate is stopped [rad, m]. Derived: twice what the quadratic program's
            solver may be off.
        at_limit: how far beyond a limit rounding may put a coordinate, which then counts as on it [rad, m]. Derived.
        singular: share added to the diagonal of the steps' equations, so that they can be solved where the tip cannot
            move one way. Derived: a thousand times rounding.
    """

    most_steps: int = 80
    length_unit: float = 1.0 / 24.0
    settled: float = 1e-11
    most_turn: float = 0.3
    damping: float = 1e-2
    relaxed: float = 0.2
    stiffened: float = 8.0
    most_damping: float = 1e8
    inset: float = 2e-6
    at_limit: float = 1e-12
    singular: float = 1e-13


DEFAULT_TIP_NEWTON = TipNewtonSettings()
"""The numbers of inverse kinematics unless others are passed."""


@dataclass(frozen=True)
class TipTarget:
    """A place for the tip and perhaps a direction for the last link.

    Attributes:
        position: shape (3,) [m].
        direction: a unit vector, shape (3,), or None when any will do.
    """

    position: FloatArray
    direction: FloatArray | None = None

    def errors(self, state: ChainState, length_unit: float) -> tuple[FloatArray, FloatArray]:
        """What the tip lacks, and how that changes with the coordinates.

        Args:
            state: the arm at its coordinates.
            length_unit: length that counts as much as one radian [m].

        Returns:
            Errors of place, and of direction along two axes across the last link, shape (3,) or (5,), and the
            derivatives of tip and direction themselves, shape (3, p) or (5, p).
        """
        error = (self.position - state.positions[-1]) / length_unit
        rows = state.jacobian[-1] / length_unit
        if self.direction is None:
            return error, rows
        last = state.rotations[-1]
        across = last[:, 1:]
        missing = self.angle(last[:, 0]) * _unit(across.T @ self.direction)
        # dt = ω × t, so y·dt = ω·(t × y) = ω·z, and z·dt = −ω·y with the axes x = t, y and z of the link.
        turning = np.stack((last[:, 2] @ state.omega[-1], -(last[:, 1] @ state.omega[-1])))
        return np.concatenate((error, missing)), np.concatenate((rows, turning))

    def angle(self, direction: FloatArray) -> float:
        """Angle between a unit vector and the direction asked for [rad]; 0 when any will do."""
        if self.direction is None:
            return 0.0
        sine = float(np.linalg.norm(np.cross(direction, self.direction)))
        return float(np.arctan2(sine, direction @ self.direction))


def _unit(vector: FloatArray) -> FloatArray:
    """A vector of length 1; the first axis where there is none, so that a link that points backwards turns at all."""
    length = float(np.linalg.norm(vector))
    return vector / length if length > 0.0 else np.eye(len(vector))[0]


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
