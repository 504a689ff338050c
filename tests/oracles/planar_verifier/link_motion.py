"""The verifier's own planar kinematics: headings, joint positions and where a link moves between two samples."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.robot.arm import Arm

from .rounding import point_rounding, turn_rounding


def link_headings(arm: Arm, positions: FloatArray) -> FloatArray:
    """Headings of the links, the running sum of the bends from the base heading, shape (..., links) [rad]."""
    return arm.base_heading + np.cumsum(positions[..., : arm.links], axis=-1)


def advance(arm: Arm, positions: FloatArray) -> FloatArray:
    """How far the base is carried along its heading, shape (...) [m]; linear, so it serves rates too."""
    return np.asarray(np.sum(positions[..., arm.links :], axis=-1))


def chain_points(arm: Arm, headings: FloatArray, carried: FloatArray) -> FloatArray:
    """Base, joints and tip, shape (..., links + 1, 2) [m].

    Args:
        arm: the arm.
        headings: of the links, shape (..., links) [rad].
        carried: how far the base is carried along its heading, shape (...) [m].
    """
    points = np.empty((*headings.shape[:-1], arm.links + 1, 2))
    points[..., 0, :] = arm.base
    # p_i = base + l Σ (cos φ_k, sin φ_k) over the links k ≤ i.
    points[..., 1:, 0] = arm.base[0] + arm.link_length * np.cumsum(np.cos(headings), axis=-1)
    points[..., 1:, 1] = arm.base[1] + arm.link_length * np.cumsum(np.sin(headings), axis=-1)
    return points + carried[..., None, None] * axis_direction(arm)


def axis_direction(arm: Arm) -> FloatArray:
    """Unit vector along which the base is carried, shape (2,)."""
    return np.array([np.cos(arm.base_heading), np.sin(arm.base_heading)])


@dataclass(frozen=True)
class Nodes:
    """Stretches of time inside sample intervals, each stood for by the pose at its middle.

    Attributes:
        interval: number of the sample interval, shape (N,).
        centre: place of the middle within the interval, from 0 to 1, shape (N,).
        half: half the stretch, as a share of the interval, shape (N,).
    """

    interval: IntArray
    centre: FloatArray
    half: FloatArray

    def __len__(self) -> int:
        return len(self.interval)

    def halves(self) -> "Nodes":
        """First and second half of every stretch, in turn, shape (2 N,)."""
        shift = 0.5 * self.half
        centre = np.stack((self.centre - shift, self.centre + shift), axis=1).ravel()
        return Nodes(np.repeat(self.interval, 2), centre, np.repeat(shift, 2))

    def take(self, index: IntArray) -> "Nodes":
        """The stretches of the given numbers."""
        return Nodes(self.interval[index], self.centre[index], self.half[index])


@dataclass(frozen=True)
class ChainMotion:
    """The arm between samples, its coordinates linear in time there.

    Attributes:
        arm: the arm.
        time: sample times, shape (T,) [s].
        positions: bends at the samples, and positions of the axes that carry the base, shape (T, c) [rad, m].
        deviation: what links may be off this motion in each interval, shape (T − 1, links) [m]; none by default.
    """

    arm: Arm
    time: FloatArray
    positions: FloatArray
    deviation: FloatArray | None = None

    @cached_property
    def off(self) -> FloatArray:
        """How far links may be off in each interval, shape (T − 1, links) [m]."""
        return np.zeros((len(self.time) - 1, self.arm.links)) if self.deviation is None else self.deviation

    @property
    def bends(self) -> FloatArray:
        """Bends at the samples, shape (T, links) [rad]."""
        return self.positions[:, : self.arm.links]

    @cached_property
    def headings(self) -> FloatArray:
        """Headings of the links at the samples, shape (T, links) [rad]."""
        return link_headings(self.arm, self.positions)

    @cached_property
    def carried(self) -> FloatArray:
        """How far the base is carried along its heading at the samples, shape (T,) [m]."""
        return advance(self.arm, self.positions)

    @cached_property
    def _heading_steps(self) -> FloatArray:
        return np.diff(self.headings, axis=0)

    @cached_property
    def turned(self) -> FloatArray:
        """Sum of |heading change| of links 1 to i in each interval, shape (T − 1, links + 1) [rad].

        The first entry, and with it all, holds how far the base is carried, in link lengths; 0 when it is fixed.
        """
        # In link lengths the base adds to the sum like one more link that turns.
        turned = _running_sum(np.abs(self._heading_steps))
        return turned + np.abs(np.diff(self.carried))[:, None] / self.arm.link_length

    @cached_property
    def carried_by(self) -> FloatArray:
        """How far the base is carried in each interval, shape (T − 1,) [m]."""
        return np.asarray(np.abs(np.diff(self.carried)))

    @cached_property
    def aslant(self) -> FloatArray:
        """By how much links lie at most across the way that the base is carried, a sine, shape (T − 1, links)."""
        across = np.abs(np.sin(self.headings - self.arm.base_heading))
        return np.asarray(np.minimum(np.maximum(across[:-1], across[1:]) + np.abs(self._heading_steps), 1.0))

    @cached_property
    def bent(self) -> FloatArray:
        """Sum of |bend change| of joints 1 to i in each interval, shape (T − 1, links + 1) [rad]; 0 first."""
        return _running_sum(np.abs(np.diff(self.bends, axis=0)))

    @cached_property
    def bent_weighted(self) -> FloatArray:
        """The same with joint i's change counted i times, shape (T − 1, links + 1) [rad]; 0 first."""
        weights = np.arange(1.0, self.arm.links + 1.0)
        return _running_sum(weights * np.abs(np.diff(self.bends, axis=0)))

    @cached_property
    def rounding(self) -> float:
        """What rounding may take from any distance of the arm at any time, besides that of the distance itself [m]."""
        return point_rounding(self.arm, self.positions) + turn_rounding(self.arm, self.positions)

    @cached_property
    def size(self) -> float:
        """What no coordinate of the arm exceeds at any time [m]."""
        farthest = float(np.max(np.abs(self.arm.base))) + self.arm.length + float(np.max(np.abs(self.carried)))
        return 2.0 * farthest

    @cached_property
    def whole(self) -> Nodes:
        """One stretch for each sample interval."""
        count = len(self.time) - 1
        return Nodes(np.arange(count), np.full(count, 0.5), np.full(count, 0.5))

    @cached_property
    def _middle_poses(self) -> FloatArray:
        poses = self._poses(self.whole)
        poses.flags.writeable = False  # one array serves all proofs
        return poses

    def poses(self, nodes: Nodes) -> FloatArray:
        """Joint and tip positions at the middle of each stretch, shape (N, links + 1, 2) [m]."""
        # Every proof begins with the whole intervals, twice.
        return self._middle_poses if nodes is self.whole else self._poses(nodes)

    def _poses(self, nodes: Nodes) -> FloatArray:
        # Bends are linear in time between samples, and so are headings, which are sums of them.
        headings = self.headings[nodes.interval] + nodes.centre[:, None] * self._heading_steps[nodes.interval]
        carried = self.carried[nodes.interval] + nodes.centre * np.diff(self.carried)[nodes.interval]
        return chain_points(self.arm, headings, carried)

    def when(self, nodes: Nodes, index: int) -> float:
        """Time of the middle of one stretch [s]."""
        k = int(nodes.interval[index])
        return float(self.time[k] + nodes.centre[index] * (self.time[k + 1] - self.time[k]))


def unit_rows(vectors: FloatArray) -> FloatArray:
    """Vectors of length 1 along given ones, shape (P, 2); of those without a length none."""
    length = np.hypot(vectors[:, 0], vectors[:, 1])
    return np.asarray(vectors / np.where(length > 0.0, length, 1.0)[:, None])


def _running_sum(values: FloatArray) -> FloatArray:
    total = np.zeros((values.shape[0], values.shape[1] + 1))
    np.cumsum(values, axis=1, out=total[:, 1:])
    return total
