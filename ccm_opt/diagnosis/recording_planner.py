"""A planner that records its paths: limits of torque and masses of links change no path, so none is planned twice."""

from dataclasses import dataclass, field, fields
from typing import Generic, Protocol, TypeVar

import numpy as np

from ccm_opt.problem import Problem
from ccm_opt.problem.space_problem import AnyProblem, SpaceProblem
from ccm_opt.solution import JointPath

_Problem = TypeVar("_Problem", Problem, SpaceProblem)
_Planned = TypeVar("_Planned", Problem, SpaceProblem, contravariant=True)  # noqa: PLC0105 - it is told beside it
OF_DRIVES = frozenset(
    ("masses", "inertia_axial", "inertia_transverse", "payload", "rotor_inertia", "friction", "axes", "stray")
)
"""What of an arm no path depends on."""


class PathFinder(Protocol[_Planned]):
    """Plans paths, in the plane or in space."""

    def plan(self, problem: _Planned) -> JointPath:
        """The path of a problem."""
        ...


@dataclass(frozen=True)
class RecordingPlanner(Generic[_Problem]):
    """A planner that hands out a recorded path again; satisfies the protocol of the one that it asks.

    Attributes:
        planner: plans what is not recorded.
        paths: recorded so far, each with the problem that it was found for.
    """

    planner: PathFinder[_Problem]
    paths: list[tuple[_Problem, JointPath]] = field(default_factory=list)

    def plan(self, problem: _Problem) -> JointPath:
        """The path of a problem; the recorded one when nothing that decides it has changed.

        Raises:
            NoPlanFound: with the reason and what would help.
        """
        for known, path in self.paths:
            if _same_geometry(known, problem):
                return path
        path = self.planner.plan(problem)
        self.paths.append((problem, path))
        return path


def _same_geometry(one: AnyProblem, other: AnyProblem) -> bool:
    """Whether all that decides a path is the same; parts that ``replace`` has left alone are the very same objects."""
    numbers = [each.name for each in fields(one.arm) if each.name not in OF_DRIVES]
    parts = ("workspace", "start", "goal", "stops")
    return (
        type(one) is type(other)
        and all(np.array_equal(getattr(one.arm, name), getattr(other.arm, name)) for name in numbers)
        and one.tolerances == other.tolerances
        and all(getattr(one, name) is getattr(other, name) for name in parts)
    )
