"""The solution of a problem, verified and timed."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from html import escape
from pathlib import Path
from typing import Any, Generic, Protocol, Self, TypeVar

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.length_words import LengthUnit, short_length, words_in
from ccm_opt.problem import Problem
from ccm_opt.solution.records import RoomRecord, SurvivedError, TryRecord
from ccm_opt.solution.stage_results import Check, JointPath, JointStates, JointTrajectory, SimulatedMotion


class Presenter(Protocol):
    """Draws, animates and saves plans."""

    def plot(self, plan: Any) -> Any:
        """A figure of a plan."""
        ...

    def animate(self, plan: Any, file: str | Path) -> Path:
        """Write a film of a plan."""
        ...

    def save(self, solution: Any, folder: str | Path) -> Path:
        """Write the folder of a plan."""
        ...


_PRESENTERS: list[Presenter] = []
"""Those who have said that they can; the last counts."""


def present_with(presenting: Presenter) -> None:
    """Let somebody draw and save plans from now on."""
    _PRESENTERS.append(presenting)


def presenter() -> Presenter:
    """Who draws and saves plans.

    Raises:
        RuntimeError: nobody has said that they can; what ``ccm_opt`` hands out does.
    """
    if not _PRESENTERS:
        raise RuntimeError("nothing that draws and saves plans is loaded; import ccm_opt.viz.saved_plans first")
    return _PRESENTERS[-1]


class ArmOfLinks(Protocol):
    """What a plan tells of its arm."""

    @property
    def links(self) -> int:
        """Number of links."""


class NamedProblem(Protocol):
    """What a plan tells of its problem, in the plane or in space."""

    @property
    def name(self) -> str:
        """Of the problem."""

    @property
    def arm(self) -> ArmOfLinks:
        """The arm that moves."""

    @property
    def length_unit(self) -> LengthUnit:
        """In which people are told lengths."""


ProblemT = TypeVar("ProblemT", bound=NamedProblem)


@dataclass(frozen=True, repr=False)
class SolutionOf(Generic[ProblemT]):
    """A verified plan for a kind of problem. What is not solved is an exception, never a solution.

    Attributes:
        problem: what was asked.
        path: the way, without time.
        trajectory: the same in time.
        joints: the same for the drives.
        simulation: what the simulated arm did.
        checks: of the verifier, then of the user's constraints; all hold.
        metrics: figures of merit, named with their units.
        timings: CPU time by stage [s].
        versions: of Python and of the packages that the plan was made with.
        room: how much room the motion keeps; None where nobody asked.
        tolerance: errors that the motion survives; none where nobody asked.
        tries: what came of every try, where several were asked for.
        not_checked: what nothing was held against, though one might think so, a clause each; none as a rule.
    """

    problem: ProblemT
    path: JointPath
    trajectory: JointTrajectory
    joints: JointStates
    simulation: SimulatedMotion
    checks: tuple[Check, ...]
    metrics: Mapping[str, float]
    timings: Mapping[str, float]
    versions: Mapping[str, str] = field(default_factory=dict)
    room: RoomRecord | None = None
    tolerance: tuple[SurvivedError, ...] = ()
    tries: tuple[TryRecord, ...] = ()
    not_checked: tuple[str, ...] = ()

    def __repr__(self) -> str:
        gap = self.metrics.get("least_wall_clearance_m", np.inf)
        with words_in(self.problem.length_unit):
            near = f", walls no nearer than {short_length(gap)}" if np.isfinite(gap) else ""
        motion = f"{self.problem.arm.links} links, {self.trajectory.duration:.2f} s{near}"
        return f"<{type(self).__name__} of '{self.problem.name}': {motion}, {len(self.checks)} checks hold>"

    def _repr_html_(self) -> str:
        """A table for notebooks: the checks with their worst values and limits."""
        cells = [
            f"<tr><td>{escape(check.name)}</td><td>{check.worst:.3g} {escape(check.unit)}</td>"
            f"<td>{check.limit:.3g}</td><td>{escape(check.where)}</td></tr>"
            for check in self.checks
        ]
        head = "<tr><th>check</th><th>worst</th><th>limit</th><th>where</th></tr>"
        return f"<p>{escape(repr(self)[1:-1])}</p><table>{head}{''.join(cells)}</table>"

    def with_room(self, room: RoomRecord) -> Self:
        """The same plan with another record of its room."""
        return replace(self, room=room)

    def plot(self) -> Any:
        """Draw the plan, see ``ccm_opt.plot``; a matplotlib figure."""
        return presenter().plot(self)

    def animate(self, file: str | Path) -> Path:
        """Write a film of the plan, see ``ccm_opt.animate``."""
        return presenter().animate(self, file)

    def save(self, folder: str | Path) -> Path:
        """Save the plan to a folder, see ``ccm_opt.save``."""
        return presenter().save(self, folder)


@dataclass(frozen=True, repr=False)
class Solution(SolutionOf[Problem]):
    """A verified plan in the plane; its attributes are those of ``SolutionOf``."""

    @property
    def joint_positions(self) -> FloatArray:
        """Joint and tip positions at every sample, shape (T, links + 1, 2) [m]."""
        return self.problem.arm.joint_positions_at(self.trajectory.positions)
