"""What checks ask of a problem that serve arms in the plane and in space alike."""

from collections.abc import Sequence
from typing import Protocol, TypeAlias

from ccm_opt.ground.arrays import FloatArray
from ccm_opt.jointed.drive_limits import Limits
from ccm_opt.jointed.driven_arm import DrivenArm
from ccm_opt.problem import PlannerOptions, SimulationOptions, VerificationOptions

Efforts: TypeAlias = tuple[FloatArray, FloatArray]
"""Torques of all revolutes, shape (T, 3 * links) [N m], and the force that carries the base, shape (T,) [N]."""


class CheckedStop(Protocol):
    """A goal on the way."""

    @property
    def pause(self) -> float:
        """How long the arm rests there [s]."""
        ...


class CheckedProblem(Protocol):
    """A problem of either kind; its attributes are those of ``Problem``."""

    @property
    def arm(self) -> DrivenArm:
        """The arm."""
        ...

    @property
    def limits(self) -> Limits:
        """Of its drives."""
        ...

    @property
    def planner(self) -> PlannerOptions:
        """What plans are asked for."""
        ...

    @property
    def simulation(self) -> SimulationOptions:
        """Gravity is in it."""
        ...

    @property
    def verification(self) -> VerificationOptions:
        """How strictly plans are judged."""
        ...

    @property
    def stops(self) -> Sequence[CheckedStop]:
        """Goals on the way, in order."""
        ...
