"""The arm as one chain from where its base is mounted to its tip, at the samples of a motion.

The way of the base along a feed axis is the first vector, before the links: link i of the arm is vector i + 1. What
the joint before a vector turns, turns everything from it on; the first of these turns is an error of the base's
heading.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ccm_opt.core.arrays import BoolArray, FloatArray, IntArray
from ccm_opt.robot.arm import Arm
from ccm_opt.verification.chain_motion import ChainMotion, carried, chain_points
from ccm_opt.verification.tolerance.chain_cases import ChainCases
from ccm_opt.verification.tolerance.error_model import ErrorModel


@dataclass(frozen=True)
class Columns:
    """What the vectors of some chains are, padded to equal numbers.

    Attributes:
        vectors: numbers of the arm's vectors, shape (m, k); −1 where there is none.
        joints: numbers of the joints before them, shape (m, k); −1 where there is none.
        backwards: whether the vectors are run against their direction.
    """

    vectors: IntArray
    joints: IntArray
    backwards: bool


@dataclass(frozen=True)
class MovingChain:
    """Vectors of the arm at some samples of a motion, and how wrong they may be.

    Attributes:
        motion: the motion.
        model: what may be wrong.
        at: numbers of the samples, from the first to the last, shape (N + 1,). Between two of them the motion counts
            as linear, and what it strays from that is added to every bound.
    """

    motion: ChainMotion
    model: ErrorModel
    at: IntArray

    @classmethod
    def through_all(cls, motion: ChainMotion, model: ErrorModel) -> "MovingChain":
        """The chain at all samples."""
        return cls(motion, model, np.arange(len(motion.time)))

    @classmethod
    def in_strides(cls, motion: ChainMotion, model: ErrorModel, travel: float) -> "MovingChain":
        """The chain at samples between which no point of the arm travels farther than some length [m], or at all."""
        arm = motion.arm
        turned = np.sum(np.abs(np.cumsum(motion.steps[:, arm.coordinates.bends], axis=1)), axis=1)
        gone = np.append(0.0, np.cumsum(arm.link_length * turned + np.abs(carried(arm, motion.steps))))
        at = [0]
        while at[-1] < len(gone) - 1:
            farthest = int(np.searchsorted(gone, gone[at[-1]] + travel, side="right")) - 1
            at.append(max(farthest, at[-1] + 1))
        return cls(motion, model, np.array(at))

    def __len__(self) -> int:
        return len(self.at) - 1

    @property
    def arm(self) -> Arm:
        """The arm."""
        return self.motion.arm

    @cached_property
    def _all_angles(self) -> FloatArray:
        x, y = self.arm.direction
        turned = np.cumsum(self.motion.positions[:, self.arm.coordinates.bends], axis=1)
        return float(np.arctan2(y, x)) + np.column_stack((np.zeros(len(turned)), turned))

    @cached_property
    def angles(self) -> FloatArray:
        """Headings of all vectors, shape (N + 1, links + 1) [rad]."""
        return self._all_angles[self.at]

    @cached_property
    def carried(self) -> FloatArray:
        """How far the base is carried, shape (N + 1,) [m]."""
        return self._all_carried[self.at]

    @cached_property
    def _all_carried(self) -> FloatArray:
        return carried(self.arm, self.motion.positions)

    @cached_property
    def lengths(self) -> FloatArray:
        """Lengths of all vectors, shape (N + 1, links + 1) [m]; the first is negative where the base is drawn back."""
        return np.column_stack((self.carried, np.full((len(self.at), self.arm.links), self.arm.link_length)))

    @cached_property
    def strays(self) -> FloatArray:
        """How far the headings of vectors leave straight lines between samples, shape (N, links + 1) [rad]."""
        return self._strays(self._all_angles)

    @cached_property
    def base_strays(self) -> FloatArray:
        """The same of the base, shape (N,) [m]."""
        return self._strays(self._all_carried[:, None])[:, 0]

    def _strays(self, values: FloatArray) -> FloatArray:
        time = self.motion.time
        straight = [np.interp(time, time[self.at], column[self.at]) for column in values.T]
        return np.maximum.reduceat(np.abs(values - np.stack(straight, axis=1)), self.at[:-1], axis=0)

    @cached_property
    def travel(self) -> FloatArray:
        """How far points of the links may be from their places half-way, shape (N, links + 1) [m]; the base first."""
        turned = 0.5 * np.abs(np.diff(self.angles, axis=0)) + self.strays
        carried = 0.5 * np.abs(np.diff(self.carried)) + self.base_strays
        return np.asarray(carried[:, None] + self.arm.link_length * np.cumsum(turned, axis=1))

    @cached_property
    def middles(self) -> FloatArray:
        """Base, joints and tip half-way, shape (N, links + 1, 2) [m]."""
        positions = self.motion.positions[self.at]
        return chain_points(self.arm, 0.5 * (positions[:-1] + positions[1:]))

    @cached_property
    def held(self) -> BoolArray:
        """Joints that a guide tube holds straight during whole intervals, shape (N, links + 1); not the base."""
        feed = np.maximum.reduceat(self._all_carried, self.at[:-1])
        feed = np.maximum(feed, self.carried[1:])
        return np.column_stack((np.zeros(len(feed), dtype=bool), self.arm.held(feed)))

    def forward(self, first: IntArray, last: IntArray) -> Columns:
        """Chains along the arm from vector ``first`` to vector ``last``, both among them, each of shape (m,)."""
        vectors = first[:, None] + np.arange(self.arm.links + 2)
        vectors = np.where(vectors <= last[:, None], vectors, -1)
        return Columns(vectors, vectors, backwards=False)

    def backward(self, joint: IntArray, last: IntArray) -> Columns:
        """Chains back along the arm from a joint to vector ``last``, that among them, each of shape (m,)."""
        joints = joint[:, None] - np.arange(self.arm.links + 2)
        vectors = joints - 1
        used = vectors >= last[:, None]
        return Columns(np.where(used, vectors, -1), np.where(used, joints, -1), backwards=True)

    def cases(
        self,
        columns: Columns,
        interval: IntArray,
        frame: IntArray | None,
        target: FloatArray,
        apart: FloatArray,
        link: IntArray,
        other: IntArray,
        *,
        with_link: bool,
    ) -> ChainCases:
        """Cases of chains over whole intervals between the samples.

        Args:
            columns: what their vectors are.
            interval: numbers of the intervals, shape (m,).
            frame: numbers of the vectors whose headings angles are counted from, shape (m,); None for the world.
            target: in that frame, shape (m, 2, 2) [m].
            apart: distance to keep, shape (m,) [m].
            link: number of the link, for the record.
            other: number of the edge or of the other link, for the record.
            with_link: whether it is a link.
        """
        count = len(interval)
        used = columns.vectors >= 0
        vectors = np.maximum(columns.vectors, 0)
        joints = np.maximum(columns.joints, 0)
        sides = interval[:, None] + np.array([0, 1])

        lengths = np.where(used[:, None], self.lengths[sides[:, :, None], vectors[:, None]], 0.0)
        angles = self.angles[sides[:, :, None], vectors[:, None]] + (np.pi if columns.backwards else 0.0)
        strays = self.strays[interval[:, None], vectors]
        if frame is not None:
            angles = angles - self.angles[sides, frame[:, None]][:, :, None]
            strays = strays + self.strays[interval, frame][:, None]
        loose = used & ~self.held[interval[:, None], joints]
        of_links = used & (vectors > 0)
        return ChainCases(
            lengths=lengths,
            angles=np.where(used[:, None], angles, 0.0),
            turns=np.where(loose, self.model.turns[joints], 0.0),
            stretches=np.where(of_links, self.model.stretch, 0.0),
            shift=np.full(count, 0.0 if with_link else self.model.moves_base),
            target=target,
            growth=np.full(count, 0.0 if frame is None else self.model.stretch),
            apart=apart,
            stray=np.sum(np.abs(lengths).max(axis=1) * strays, axis=1) + self.base_strays[interval],
            joints=np.where(used, joints, -1),
            sense=np.full(count, -1.0 if columns.backwards else 1.0),
            interval=interval,
            stretch=np.tile([0.0, 1.0], (count, 1)),
            link=link,
            other=other,
            with_link=np.full(count, with_link),
        )
