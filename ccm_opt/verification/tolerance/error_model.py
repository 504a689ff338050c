"""Errors of joints, links, base, walls and loads, and their numbers."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.problem.solution import Check, SurvivedError
from ccm_opt.robot.arm import Arm

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


def joint_errors(arm: Arm) -> ErrorModel:
    """Every joint is off by as much as the unit, and the base on a feed axis by a link's length times that."""
    turns = np.append(0.0, np.ones(arm.links))
    feed = arm.link_length * len(arm.base_axes)
    return ErrorModel("joints", "rad", turns, feed=feed)


def base_heading_error(arm: Arm) -> ErrorModel:
    """The arm stands turned about its base."""
    return ErrorModel("base heading", "rad", np.append(1.0, np.zeros(arm.links)), with_itself=False)


def link_length_errors(arm: Arm) -> ErrorModel:
    """Every link is longer or shorter by as much as the unit, each by itself."""
    return ErrorModel("link lengths", "m", np.zeros(arm.links + 1), stretch=1.0)


def base_position_error(arm: Arm) -> ErrorModel:
    """The arm stands beside its place, in any direction."""
    return ErrorModel("base position", "m", np.zeros(arm.links + 1), shift=1.0, with_itself=False)


def wall_errors(arm: Arm) -> ErrorModel:
    """Every wall is nearer to the arm by as much as the unit: the certified least gap."""
    return ErrorModel("walls", "m", np.zeros(arm.links + 1), shift=1.0, with_itself=False)


MODELS: tuple[Callable[[Arm], ErrorModel], ...] = (
    joint_errors,
    link_length_errors,
    base_heading_error,
    base_position_error,
    wall_errors,
)
"""Everything that may be wrong with the geometry."""


@dataclass(frozen=True)
class ToleranceSettings:
    """Numbers of the search for the largest errors that a motion survives.

    Attributes:
        precision: share by which the certified error may stay below the least one that the bound refuses at some
            pose. Taste.
        least: errors below this count as none [rad, m]. Derived: far below what the verifier tells apart.
        largest_turn: errors of angles that may turn the tip by more than this, all together, are not looked at [rad].
            Taste: bounds are tight up to some 0.2 rad, and an arm so far off follows no plan.
        largest_length: the same of lengths, as a share of the arm's length. Taste.
        refinements: shares tried between one that found too little and one that found nothing. Taste.
        time_share: share of the time left that a search with such room may take. Taste.
        least_time: that a search is given in any case [s]. Taste.
    """

    precision: float = 2e-3
    least: float = 1e-7
    largest_turn: float = 1.2
    largest_length: float = 0.25
    refinements: int = 3
    time_share: float = 0.4
    least_time: float = 1.0


DEFAULT_TOLERANCE = ToleranceSettings()
"""What is used unless others are given."""


def largest_error(arm: Arm, model: ErrorModel, settings: ToleranceSettings = DEFAULT_TOLERANCE) -> float:
    """Errors above this are not looked at [unit]."""
    turned = float(np.sum(model.turns))
    return settings.largest_turn / turned if turned > 0.0 else settings.largest_length * arm.length


NAME = "survived joint error"
"""Of the check."""


def check_of(asked: float, survived: SurvivedError) -> Check:
    """The check of an error that is known already, against the one asked for [rad]."""
    # What lies beyond is not looked at, so a problem that asks for more is refused.
    passed = survived.size >= asked
    return Check(NAME, survived.size, asked, "rad", survived.where, passed=passed)
