"""The verifier's own kinematics in space: axes of the links, carried on by turns about two of them."""

from dataclasses import dataclass

import numpy as np

from ccm_opt.ground.arrays import FloatArray
from ccm_opt.jointed.space_arm import SpaceArm


@dataclass(frozen=True)
class LinkFrames:
    """How the links are turned in T poses.

    Attributes:
        first_axes: about which the joints turn first, the z axes of the links before, shape (T, links, 3).
        second_axes: about which they turn then, the y axes of the links themselves, likewise.
        along: directions of the links, likewise.
        across: their z axes, likewise.
    """

    first_axes: FloatArray
    second_axes: FloatArray
    along: FloatArray
    across: FloatArray

    @classmethod
    def of(cls, arm: SpaceArm, positions: FloatArray) -> "LinkFrames":
        """The frames of configurations, shape (T, c)."""
        shape = (len(positions), arm.links, 3)
        frames = cls(np.empty(shape), np.empty(shape), np.empty(shape), np.empty(shape))
        # Left, up and ahead of the base make a frame that turns right: ahead × left = up.
        ahead = np.broadcast_to(arm.direction, (len(positions), 3))
        up = np.broadcast_to(arm.up, ahead.shape)
        left = np.cross(up, ahead)
        bends = np.ascontiguousarray(positions[:, : 2 * arm.links].T)
        cosines = np.cos(bends)[:, :, None]
        sines = np.sin(bends)[:, :, None]
        for link in range(arm.links):
            frames.first_axes[:, link] = up
            cosine, sine = cosines[2 * link], sines[2 * link]
            turned = cosine * ahead + sine * left
            left = cosine * left - sine * ahead
            frames.second_axes[:, link] = left
            cosine, sine = cosines[2 * link + 1], sines[2 * link + 1]
            # About left a turn brings up towards ahead, and ahead down.
            ahead = cosine * turned - sine * up
            up = cosine * up + sine * turned
            frames.along[:, link] = ahead
            frames.across[:, link] = up
        return frames


def carried(arm: SpaceArm, positions: FloatArray) -> FloatArray:
    """How far the base is carried along its direction, shape (T,) [m]; linear, so it serves rates too."""
    return np.asarray(np.sum(positions[:, 2 * arm.links :], axis=1))


def chain_of(arm: SpaceArm, positions: FloatArray) -> FloatArray:
    """Base, joints and tip in configurations (T, c), shape (T, links + 1, 3) [m]."""
    along = LinkFrames.of(arm, positions).along
    points = np.empty((len(positions), arm.links + 1, 3))
    points[:, 0] = arm.base + carried(arm, positions)[:, None] * arm.direction
    points[:, 1:] = points[:, :1] + arm.link_length * np.cumsum(along, axis=1)
    return points
