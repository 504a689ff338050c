"""Drives that move several joints of an arm together: the bends of the joints are q = C d for the drives d.

The columns of C are independent, so that bends in the range of C have one value of each drive. Efforts of the joints
give those of the drives, Cᵀ τ.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ccm_opt.core.arrays import FloatArray, IntArray

DRIVES_MISFIT = 1e-9
"""Largest difference of a joint's bend from its share of its drive that is attributed to rounding [rad]."""


class DriveCoupling(ABC):
    """Abstract coupling of the joints of an arm, of k bends each, to m drives."""

    @property
    @abstractmethod
    def coupling(self) -> FloatArray:
        """Derivatives of the bends of the joints with respect to the drives, shape (k links, m)."""

    @property
    @abstractmethod
    def drive_names(self) -> tuple[str, ...]:
        """Names of the drives."""

    @property
    @abstractmethod
    def drive_order(self) -> IntArray:
        """Indices of the drives in the order of the unknowns in which motions are planned, shape (m,)."""

    @property
    @abstractmethod
    def drive_limits(self) -> FloatArray:
        """Bound on the absolute value of each drive, shape (m,) [rad]."""

    @property
    @abstractmethod
    def drive_lengths(self) -> FloatArray:
        """Reciprocal of the greatest curvature of the arm for a unit of each drive, shape (m,) [m]."""

    @property
    @abstractmethod
    def drive_scales(self) -> FloatArray:
        """Change of each drive that changes the bends of the joints by a unit in all, shape (m,)."""

    @property
    def travel_rows(self) -> FloatArray:
        """Fraction of its travel that each limited tendon takes for a unit of each joint's bends, (t, k links)."""
        return np.zeros((0, len(self.coupling)))

    @abstractmethod
    def of_drives(self, values: FloatArray) -> FloatArray:
        """Return the torque limits of the drives, shape (m,), which all revolutes that they move have, (3 links,)."""

    def drives(self, bends: FloatArray) -> FloatArray:
        """Return the values of the drives, shape (..., m), nearest to bends of the joints, (..., k links) [rad].

        The map is linear, so it also applies to velocities and accelerations.
        """
        return np.asarray(bends @ np.linalg.pinv(self.coupling).T)

    def least_moved(self, values: FloatArray) -> FloatArray:
        """Return for each drive, shape (m,), the least value of the joints that it moves, of values (links,)."""
        moves = np.any(self.coupling.reshape(len(values), -1, len(self.drive_names)), axis=1)
        return np.asarray(np.min(np.where(moves, values[:, None], np.inf), axis=0))

    def misfit(self, bends: FloatArray) -> float:
        """Return by how much bends of the joints, (..., k links), differ from the nearest of the drives, at most."""
        return float(np.max(np.abs(bends - self.drives(bends) @ self.coupling.T)))

    def nearest(self, bends: FloatArray, within: float) -> FloatArray:
        """Return the bends that drives within their limits give next to rounded ones, (2 links,) [rad].

        Bends that fit the drives except for the rounding of floating-point numbers, or differ by more than ``within``
        [rad] from the nearest, are returned as they are.
        """
        if self.misfit(bends) <= DRIVES_MISFIT:
            return bends
        found = self.coupling @ np.clip(self.drives(bends), -self.drive_limits, self.drive_limits)
        return np.asarray(found if np.max(np.abs(found - bends)) <= within else bends)

    def travel_used(self, bends: FloatArray) -> float:
        """Return the greatest fraction of its travel by which bends of the joints, (..., k links), move a tendon."""
        return float(np.max(np.abs(bends @ self.travel_rows.T), initial=0.0))


@dataclass(frozen=True, eq=False)
class CoupledJoints(DriveCoupling):
    """The coupling of joints that turn by constant ratios of their drives, such as those of a finger.

    Attributes:
        ratios: derivatives of the bends of the joints with respect to the drives, with one drive that moves a bend at
            most, shape (2 links, m).
        names: names of the drives.
        limits: bound on the absolute value of each bend of a joint, shape (2 links,) [rad].
        link_lengths: length of each link, shape (links,) [m].
    """

    ratios: FloatArray
    names: tuple[str, ...]
    limits: FloatArray
    link_lengths: FloatArray

    @property
    def coupling(self) -> FloatArray:
        """Derivatives of the bends of the joints with respect to the drives, shape (2 links, m)."""
        return self.ratios

    @property
    def drive_names(self) -> tuple[str, ...]:
        """Names of the drives, such as ``section2_drive1``."""
        return self.names

    @property
    def drive_order(self) -> IntArray:
        """Indices of the drives as they are, shape (m,)."""
        return np.arange(len(self.names))

    @cached_property
    def drive_limits(self) -> FloatArray:
        """Greatest absolute value of each drive within the limits of the joints that it moves, shape (m,) [rad]."""
        return self.shared(self.limits)

    @cached_property
    def drive_lengths(self) -> FloatArray:
        """Least length of a link over the ratio of the joint before it, shape (m,) [m]."""
        return np.asarray(1.0 / np.max(np.abs(self.ratios) / np.repeat(self.link_lengths, 2)[:, None], axis=0))

    @cached_property
    def drive_scales(self) -> FloatArray:
        """Change of each drive that changes the bends of the joints by a unit in all, shape (m,)."""
        return np.asarray(1.0 / np.linalg.norm(self.ratios, axis=0))

    @cached_property
    def leading(self) -> IntArray:
        """Index of the bend that each drive turns most, shape (m,)."""
        return np.asarray(np.argmax(np.abs(self.ratios), axis=0))

    def shared(self, values: FloatArray) -> FloatArray:
        """Return the greatest values of the drives, shape (m,), with which bends are within theirs, (2 links,)."""
        bend, drive = np.nonzero(self.ratios)
        found = np.full(len(self.names), np.inf)
        np.minimum.at(found, drive, values[bend] / np.abs(self.ratios[bend, drive]))
        return found

    def at_joints(self, values: FloatArray, *, rates: bool) -> FloatArray:
        """Return for each revolute the value of the drive that moves it, (3 links,); the least for those that rest.

        Args:
            values: values of all drives or of each, shape (m,).
            rates: whether values are of rates, of which the revolutes have their ratio, and not of efforts.
        """
        each = np.broadcast_to(values, (len(self.names),))
        of_bends = np.full(len(self.ratios), np.min(each))
        bend, drive = np.nonzero(self.ratios)
        of_bends[bend] = each[drive] * (np.abs(self.ratios[bend, drive]) if rates else 1.0)
        both = of_bends.reshape(-1, 2)
        return np.column_stack((both, np.min(both, axis=1))).ravel()

    def of_drives(self, values: FloatArray) -> FloatArray:
        """Return the torque limits of the drives, shape (m,), which all revolutes that they move have, (3 links,)."""
        return np.asarray(values.reshape(-1, 3)[:, :2].ravel()[self.leading])
