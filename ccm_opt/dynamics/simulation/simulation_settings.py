"""Numbers of the simulation that the problem file does not set; ``problem.SimulationOptions`` holds those it does."""

from dataclasses import dataclass


@dataclass(frozen=True)
class SimulationSettings:
    """Numbers of the checks before a simulation and of its run.

    Attributes:
        largest_bend: bend up to which an arm of Z-Y-X balls is simulated out of its plane [rad]. Derived: at 90° the
            ball is singular, and at 1.3 rad its yaw turns 1 / cos 1.3 = 3.7 times as fast as the link; taste beyond
            that.
        checked_poses: number of poses along the motion at which gains and friction are held against the mass matrix.
            Taste: λmax varies slowly along a motion, and a pose costs one mass matrix and one eigenvalue.
        chunk_steps: steps in one call of the loop. Taste: a call costs microseconds, and a state that is not finite is
            noticed when its call ends.
        strayed: error of a joint above which the arm does not follow its plan [rad]. Taste.
        lost: error of a joint at which the arm has left its plan for good and the run is stopped [rad]. Taste: a joint
            that is off by a whole radian follows nothing.
        step_halvings: how often the step is halved, at most, before the arm is said not to follow its plan. Taste: a
            sixteenth of the step costs sixteen times the run.
        same_error: relative difference of two tracking errors, at a step and at half of it, below which the step is not
            what keeps the arm from following, so that no smaller one is tried. Taste.
        advised_share: share of a stability bound that figures in advice make use of. Taste.
        advised_damping: advised derivative gain over the least stable one. Taste.
    """

    largest_bend: float = 1.3
    checked_poses: int = 9
    chunk_steps: int = 200
    strayed: float = 0.1
    lost: float = 1.0
    step_halvings: int = 4
    same_error: float = 0.1
    advised_share: float = 0.9
    advised_damping: float = 1.2


DEFAULT_SIMULATION = SimulationSettings()
"""What every simulation uses unless it is given others."""


@dataclass(frozen=True)
class BrakingSettings:
    """Numbers of coming to rest along a planned motion.

    Attributes:
        step: largest time between two samples while braking [s]. Taste.
        limit_shares: shares of every limit to brake with, the first with which all samples keep the limits: between the
            places that are checked, the planned motion's own accelerations change. Taste.
        checked_places: places in a step at which the limits are held, from 0 to 1. Taste.
        least_time: braking from the planned rate to rest takes at least this, however slowly the axes move [s]. Taste.
        longest_time: braking that takes longer has failed [s]. Taste.
        longest_last_step: longest last step in units of ``step``; a shorter rest is made part of the step before it, so
            that no step is very short. Taste.
    """

    step: float = 2e-3
    limit_shares: tuple[float, ...] = (0.97, 0.93, 0.87, 0.8)
    checked_places: tuple[float, ...] = (0.0, 1.0 / 3.0, 2.0 / 3.0, 1.0)
    least_time: float = 4e-3
    longest_time: float = 60.0
    longest_last_step: float = 1.5


DEFAULT_BRAKING = BrakingSettings()
"""What every braking uses unless it is given others."""
