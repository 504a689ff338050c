"""Independent computation of minimum durations, by two sweeps over the phase plane, for pendulums with friction.

With x = ṡ² and s̈ constant over a short step, x' = 2 s̈. Every limit bounds s̈ at given s and x. The backward sweep
finds the maximum x from which the end of the path can be reached; the forward sweep accelerates as fast as possible
below this maximum. All limits are fully used, so a motion within the limits cannot be much faster.
"""

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.problem import Limits
from ccm_opt.problem.solution import JointPath
from tests.retiming_paths import GRAVITY, LENGTH, MASS

STEPS = 2000
REFINEMENTS = 3
LATTICE = 48
NO_LEVER = 1e-12


def fastest_duration(path: JointPath, limits: Limits, friction: float) -> float:
    """Return the minimum duration along a joint path of pendulums, with an error of about 1 % [s].

    Args:
        path: joint path with parameter u in [0, 1].
        limits: limits of velocity, acceleration and torque of all revolute joints.
        friction: coefficient of viscous friction in every bend axis [N m s/rad].
    """
    s = _grid()
    plane = _PhasePlane(path, limits, friction, 0.5 * (s[1:] + s[:-1]))
    width = 2.0 * np.diff(s)
    most = np.zeros(len(s))
    for k in range(len(width) - 1, -1, -1):
        most[k] = _greatest(plane, k, width[k], most[k + 1])
    x = np.zeros(len(s))
    for k in range(len(width)):
        low, high = plane.bounds(k, x[k : k + 1])
        x[k + 1] = min(max(x[k] + width[k] * max(high[0], low[0]), 0.0), most[k + 1])
    speed = np.sqrt(x)
    return float(np.sum(width / np.maximum(speed[1:] + speed[:-1], 1e-9)))


class _PhasePlane:
    """Bounds of s̈ at given s and ṡ², from the equation of motion τ = m l² q̈ + m g l cos q + f q̇ of bends q."""

    def __init__(self, path: JointPath, limits: Limits, friction: float, s: FloatArray) -> None:
        q, first, second = (path.spline(s, nu) for nu in range(3))
        velocity = limits.velocity[1::3]
        acceleration = limits.acceleration[1::3]
        assert limits.torque is not None
        torque = limits.torque[1::3]
        inertia = MASS * LENGTH**2 / torque
        self.gain = np.concatenate((first / acceleration, -inertia * first), axis=1)[:, :, None]
        self.squared = np.concatenate((second / acceleration, -inertia * second), axis=1)[:, :, None]
        self.linear = np.concatenate((0.0 * first, -friction / torque * first), axis=1)[:, :, None]
        self.static = np.concatenate((0.0 * q, MASS * GRAVITY * LENGTH / torque * np.cos(q)), axis=1)[:, :, None]
        self.cap = np.minimum(np.min((velocity / np.maximum(np.abs(first), NO_LEVER)) ** 2, axis=1), 1e6)

    def bounds(self, k: int, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return lower and upper bounds of s̈ in step k for given ṡ²; the lower one is larger if no s̈ is possible."""
        rest = self.squared[k] * x + self.linear[k] * np.sqrt(x) + self.static[k]
        gain = self.gain[k]
        lever = np.abs(gain) > NO_LEVER
        sides = np.stack(((1.0 - rest) / np.where(lever, gain, 1.0), (-1.0 - rest) / np.where(lever, gain, 1.0)))
        low = np.where(lever, sides.min(axis=0), -1e12).max(axis=0)
        high = np.where(lever, sides.max(axis=0), 1e12).min(axis=0)
        blocked = np.any(~lever & (np.abs(rest) > 1.0), axis=0)
        return low, np.where(blocked, -np.inf, high)


def _greatest(plane: _PhasePlane, k: int, width: float, reach: float) -> float:
    """Return the maximum ṡ² in step k from which a ṡ² of at most ``reach`` is possible at the end of the step.

    The maximum is found on successively refined grids.

    Args:
        plane: bounds of s̈.
        k: index of the step.
        width: factor from s̈ to the change of ṡ² in the step.
        reach: maximum ṡ² at the end of the step.
    """
    x = plane.cap[k] * np.concatenate(([0.0], np.geomspace(1e-9, 1.0, 10 * LATTICE)))
    best = 0.0
    for _ in range(REFINEMENTS):
        low, high = plane.bounds(k, x)
        good = np.flatnonzero((low <= high) & (x + width * low <= reach) & (x + width * high >= 0.0))
        if len(good) == 0:
            break
        best = float(x[good[-1]])
        x = np.linspace(best, x[min(good[-1] + 1, len(x) - 1)], LATTICE)
    return best


def _grid() -> FloatArray:
    """Return evenly spaced path parameters in [0, 1], refined near both ends, where a motion starts from rest."""
    even = np.linspace(0.0, 1.0, STEPS + 1)
    ends = np.linspace(0.0, 1.0, 100)[1:-1] ** 3 * even[1]
    return np.union1d(even, np.concatenate((ends, 1.0 - ends)))
