"""Plans of one problem from the fastest to the roomiest, and which of them an engineer would run."""

from dataclasses import dataclass

import numpy as np

from ccm_opt.problem import Problem
from ccm_opt.solution.solution import Solution


@dataclass(frozen=True, eq=False)
class ParetoPlan:
    """A plan for one wanted gap.

    Attributes:
        wanted_gap: that was asked for [m].
        solution: verified, with its room and its price; None when there is none.
        reason: why there is none; empty when there is one.
        cpu: CPU time of planning, timing and verification [s].
        dominated_by: number from 1 of a plan that is no slower and has no less room, and more of one of them; 0 when
            there is none.
    """

    wanted_gap: float
    solution: Solution | None
    reason: str = ""
    cpu: float = 0.0
    dominated_by: int = 0

    @property
    def duration(self) -> float:
        """Of the motion [s]; inf without one."""
        return np.inf if self.solution is None else self.solution.trajectory.duration

    @property
    def gap(self) -> float:
        """Least gap of the motion beyond radius and clearance [m]; -inf without one."""
        if self.solution is None or self.solution.room is None:
            return -np.inf
        return self.solution.room.nearest.gap

    @property
    def energy(self) -> float:
        """Work that the drives do and take back, the integral of effort times speed without its sign [J].

        Infinite without a motion.
        """
        if self.solution is None:
            return np.inf
        joints = self.solution.joints
        trajectory = self.solution.trajectory
        power = np.abs(joints.torques * joints.velocities).sum(axis=1)
        power = power + np.abs(joints.base_forces * trajectory.base_velocities).sum(axis=1)
        return float(np.trapezoid(power, trajectory.time))

    @property
    def peak_torque(self) -> float:
        """Largest torque of any joint [N m]; inf without a motion."""
        return np.inf if self.solution is None else float(np.max(np.abs(self.solution.joints.torques), initial=0.0))


@dataclass(frozen=True, eq=False)
class ParetoPlans:
    """The trade-off between time and room.

    Attributes:
        problem: what was asked.
        plans: in the order of their wanted gaps, the first without one.
        recommended: number from 1 of the plan to run.
        most_time: share by which that plan may be slower than the fastest.
    """

    problem: Problem
    plans: tuple[ParetoPlan, ...]
    recommended: int
    most_time: float

    @property
    def best(self) -> Solution:
        """The plan to run."""
        solution = self.plans[self.recommended - 1].solution
        if solution is None:
            raise ValueError("no plan is recommended")
        return solution

    @property
    def fastest(self) -> float:
        """The shortest duration [s]."""
        return min(plan.duration for plan in self.plans)
