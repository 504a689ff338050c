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
        advised_share: share of a stability bound that figures in advice make use of. Taste.
        advised_damping: advised derivative gain over the least stable one. Taste.
    """

    largest_bend: float = 1.3
    checked_poses: int = 9
    chunk_steps: int = 200
    advised_share: float = 0.9
    advised_damping: float = 1.2


DEFAULT_SIMULATION = SimulationSettings()
"""What every simulation uses unless it is given others."""
