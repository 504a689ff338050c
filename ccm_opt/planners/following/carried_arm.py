"""An arm on its feed axis as one chain: its poses have one column more, the feed in link lengths.

Between two keyframes that column is linear like the headings, so it moves every joint along a straight line and adds
nothing to the sag that the certificate allows for. In link lengths it weighs in sums like a heading does.
"""

from dataclasses import dataclass, fields

import numpy as np

from ccm_opt.arrays import FloatArray
from ccm_opt.jointed.arm import Arm


@dataclass(frozen=True)
class CarriedArm(Arm):
    """An arm whose poses are link headings and then the feed in link lengths, shape (..., links + 1)."""

    @classmethod
    def of(cls, arm: Arm) -> "CarriedArm":
        """The same arm, with the feed in its poses."""
        return cls(**{each.name: getattr(arm, each.name) for each in fields(arm)})

    def joint_positions(self, headings: FloatArray, feed: FloatArray | float = 0.0) -> FloatArray:
        """Positions of the joints and the tip, shape (..., links + 1, 2) [m].

        Args:
            headings: poses, shape (..., links + 1) [rad, last link lengths].
            feed: on top of the pose's own [m].
        """
        return super().joint_positions(headings[..., :-1], feed + self.link_length * headings[..., -1])

    def poses(self, path: FloatArray) -> FloatArray:
        """Poses from bends [rad] and the feed [m], both of shape (..., links + 1)."""
        return np.concatenate((self.headings(path[..., :-1]), path[..., -1:] / self.link_length), axis=-1)
