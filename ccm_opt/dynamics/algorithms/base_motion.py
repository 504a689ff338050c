"""Motion of a base that axes carry, and the efforts of the axes, by spatial vectors about the world's origin.

An axis with the direction z through the point c has the unit twist S = (z, c × z) if it is revolute and (0, z) if it is
prismatic. Twists add up from the ground, V = Σ S q̇, and so do their derivatives, V' = Σ S q̈ + V × S q̇; the effort of an
axis is S · W, with the wrench W that the arm exerts (Featherstone, Rigid Body Dynamics Algorithms, section 3.3).
"""

from dataclasses import dataclass

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.base_axes import BaseFrames


@dataclass(frozen=True)
class CarriedBase:
    """A base that k axes carry, in N states.

    Attributes:
        frames: where the base and the axes are.
        twists: unit twists of the axes, angular parts first, shape (N, k, 6).
        inertia: inertia of the drive of each axis, shape (k,) [kg, kg m²].
    """

    frames: BaseFrames
    twists: FloatArray
    inertia: FloatArray

    @classmethod
    def at(cls, arm: Arm, place: FloatArray) -> "CarriedBase":
        """Return the base of an arm for positions of its axes, shape (N, k) [m, rad]."""
        q = np.concatenate((np.zeros((len(place), arm.coordinates.joints)), place), axis=1)
        frames = arm.carried(q)
        turns = arm.axis_rows[:, :1]
        along = frames.directions
        twists = np.concatenate((turns * along, np.where(turns, np.cross(frames.points, along), along)), axis=-1)
        return cls(frames, twists, np.array([axis.inertia for axis in arm.base_axes]))

    def state(self, velocity: FloatArray, acceleration: FloatArray, gravity: FloatArray) -> FloatArray:
        """Return (ω, ω̇, a − g) of the base in its own frame, shape (N, 9), from those of the axes, each (N, k)."""
        twist, gain = np.zeros((2, len(velocity), 6))
        for k in range(self.twists.shape[1]):
            unit = self.twists[:, k]
            own = velocity[:, k, None] * unit
            turned = np.cross(twist[:, :3], own[:, :3])
            moved = np.cross(twist[:, :3], own[:, 3:]) + np.cross(twist[:, 3:], own[:, :3])
            gain = gain + acceleration[:, k, None] * unit + np.concatenate((turned, moved), axis=1)
            twist = twist + own
        place, rate = self.frames.place, twist[:, :3]
        speed = twist[:, 3:] + np.cross(rate, place)
        felt = gain[:, 3:] + np.cross(gain[:, :3], place) + np.cross(rate, speed) - gravity
        into = np.swapaxes(self.frames.rotation, 1, 2)
        return np.concatenate([np.einsum("nij,nj->ni", into, each) for each in (rate, gain[:, :3], felt)], axis=1)

    def efforts(self, wrench: FloatArray, acceleration: FloatArray) -> FloatArray:
        """Return the efforts of the axes, shape (N, k) [N, N m].

        Args:
            wrench: force on the base and moment about it that the arm requires, in its frame, shape (N, 6) [N, N m].
            acceleration: accelerations of the axes, shape (N, k).
        """
        rotation = self.frames.rotation
        force = np.einsum("nij,nj->ni", rotation, wrench[:, :3])
        moment = np.einsum("nij,nj->ni", rotation, wrench[:, 3:]) + np.cross(self.frames.place, force)
        whole = np.concatenate((moment, force), axis=1)
        return np.asarray(np.einsum("nkc,nc->nk", self.twists, whole) + self.inertia * acceleration)
