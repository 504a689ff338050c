"""The joint limits: every bend stays within a share of its bound, or at least gets no larger."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ccm_opt.ground.arrays import FloatArray
from ccm_opt.motion.limits.limit import KeyframeRows, Limit, LimitRows
from ccm_opt.motion.link_space import LinkSpace
from ccm_opt.motion.pose import Pose
from ccm_opt.motion.settings.step_settings import StepSettings

if TYPE_CHECKING:
    from ccm_opt.motion.swept_motion import Sweep

_SOLVER_ACCURACY = 1e-6
"""By which the step's QP may miss a row [rad]."""


@dataclass(frozen=True)
class JointLimit(Limit):
    """Bounds the bends.

    Bends are linear in the coordinates and, between keyframes, in the path parameter: rows are exact, and a motion
    whose keyframes keep the limits keeps them throughout.

    Attributes:
        settings: of the step.
    """

    settings: StepSettings

    def linearised(self, space: LinkSpace, pose: Pose, jacobians: FloatArray, turn: float) -> LimitRows:
        """Rows of the bends that the step could bring to their bound."""
        del jacobians
        bends = space.bends(pose.headings)
        limits = self.settings.limit_share * space.bend_limits
        tight = np.abs(bends) + 2.0 * turn > limits  # a bend is the difference of two headings
        # A bend that is beyond its share already must not grow; clipping at 0 keeps δ = 0 feasible.
        upper = np.maximum(limits - bends, 0.0)[tight]
        lower = np.minimum(-limits - bends, 0.0)[tight]
        allowed = np.maximum(self._accepted(space), np.abs(bends)) + _SOLVER_ACCURACY

        def keeps(trial: Pose) -> bool:
            return bool(np.all(np.abs(space.bends(trial.headings)) <= allowed))

        return LimitRows(space.bend_rows[tight], lower, upper, keeps=keeps)

    def keeps_at_goal(self, space: LinkSpace, near: Pose, final: Pose) -> bool:
        """Whether the pose on the goal is within the limits."""
        del near
        return bool(np.all(np.abs(space.bends(final.headings)) <= self._accepted(space)))

    def keyframe_rows(self, sweep: "Sweep", u: FloatArray) -> tuple[KeyframeRows, ...]:
        """Rows of the bends near their bound at keyframes after the first."""
        del u
        space = sweep.space
        bends = space.bends(sweep.headings)
        limits = np.broadcast_to(self.settings.limit_share * space.bend_limits, bends.shape)

        # Far from its limit a bend needs no row: every row costs the QP time, and ``holds`` judges all bends
        # afterwards.
        near = np.abs(bends) + self.settings.near_joint_limit > limits
        # The first keyframe is the start and cannot move.
        near[0] = False
        keyframe, joint = np.nonzero(near)
        lower = np.minimum((-limits - bends)[near], 0.0)
        upper = np.maximum((limits - bends)[near], 0.0)
        return (KeyframeRows(keyframe, space.bend_rows[joint], lower, upper),)

    def holds(self, sweep: "Sweep", before: "Sweep", u: FloatArray) -> bool:
        """Whether no bend is beyond its limit, nor nearer to it than accepted or than it was."""
        del u
        space = sweep.space
        allowed = np.maximum(self._accepted(space), np.abs(space.bends(before.headings)))
        return not np.any(np.abs(space.bends(sweep.headings)) > np.minimum(allowed, space.bend_limits))

    def _accepted(self, space: LinkSpace) -> FloatArray:
        """Bends that are accepted after a step: half-way between what planning uses and the limit."""
        accepted: FloatArray = 0.5 * (1.0 + self.settings.limit_share) * space.bend_limits
        return accepted


def overbent(
    limits: FloatArray, bends: FloatArray, held: FloatArray, tolerance: float
) -> tuple[FloatArray, FloatArray]:
    """Slopes of bends too near their limit by the link headings, shape (k, links), and their way back [rad].

    Args:
        limits: to which bends are brought back, shape (links,) [rad].
        bends: shape (links,) [rad].
        held: side to which each bend was too large before, or 0; such bends are kept at the limit, so that Newton's
            method does not go to and fro. What is too large now is added. Shape (links,).
        tolerance: by which a bend may be beyond [rad].
    """
    # An active set that only grows: a bend let go as soon as it is back would be pushed out again by the next step.
    beyond = np.abs(bends) > limits + tolerance
    held[beyond] = np.sign(bends[beyond])
    over = np.flatnonzero(held)
    # Bend i is φ_i − φ_{i−1}, and that of the first joint is φ_0 less the mount, which is fixed.
    slopes = np.diff(np.eye(len(bends)), axis=0, prepend=0.0)[over]
    return slopes, held[over] * limits[over] - bends[over]
