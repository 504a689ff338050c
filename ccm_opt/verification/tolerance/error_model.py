"""What may be wrong with an arm, a unit of error for everything that is wrong at once."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from ccm_opt.ground.arrays import FloatArray
from ccm_opt.jointed.driven_arm import DrivenArm

ErrorName = Literal["joints", "base heading", "link lengths", "base position", "walls"]


@dataclass(frozen=True)
class ErrorModel:
    """How much everything may be off when the error is one unit.

    Attributes:
        name: what is wrong.
        unit: of the error, "rad" or "m".
        turns: of the base's heading and of every joint, shape (links + 1,) [rad a unit].
        stretch: of the length of every link [m a unit].
        shift: of the whole arm against the walls, in any direction [m a unit].
        feed: of the base along its feed axis [m a unit].
        with_itself: whether distances within the arm change.
    """

    name: ErrorName
    unit: str
    turns: FloatArray
    stretch: float = 0.0
    shift: float = 0.0
    feed: float = 0.0
    with_itself: bool = True

    @property
    def moves_base(self) -> float:
        """How far the base is off at most [m a unit]."""
        return self.shift + self.feed


def joint_errors(arm: DrivenArm) -> ErrorModel:
    """Every joint is off by as much as the unit, and the base on a feed axis by a link's length times that."""
    turns = np.append(0.0, np.ones(arm.links))
    feed = arm.link_length * len(arm.base_axes)
    return ErrorModel("joints", "rad", turns, feed=feed)


def base_heading_error(arm: DrivenArm) -> ErrorModel:
    """The arm stands turned about its base."""
    return ErrorModel("base heading", "rad", np.append(1.0, np.zeros(arm.links)), with_itself=False)


def link_length_errors(arm: DrivenArm) -> ErrorModel:
    """Every link is longer or shorter by as much as the unit, each by itself."""
    return ErrorModel("link lengths", "m", np.zeros(arm.links + 1), stretch=1.0)


def base_position_error(arm: DrivenArm) -> ErrorModel:
    """The arm stands beside its place, in any direction."""
    return ErrorModel("base position", "m", np.zeros(arm.links + 1), shift=1.0, with_itself=False)


def wall_errors(arm: DrivenArm) -> ErrorModel:
    """Every wall is nearer to the arm by as much as the unit: the certified least gap."""
    return ErrorModel("walls", "m", np.zeros(arm.links + 1), shift=1.0, with_itself=False)
