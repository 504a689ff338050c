"""The solution of a problem, verified and timed."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from html import escape
from pathlib import Path
from typing import Any, Protocol, Self

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.length_words import short_length, words_in
from ccm_opt.problem import Problem, TipGoal
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


@dataclass(frozen=True)
class GoalErrors:
    """How the last link of a motion lies at its goal.

    Attributes:
        position: distance of the tip from where it should be [m]; None for a goal of joints.
        direction: angle between where the last link points and where it should [rad]; None where any will do.
        roll: by which the last link is turned about its own axis, against the base turned to the same direction by the
            shortest turn [rad]; it follows from the bends.
    """

    position: float | None
    direction: float | None
    roll: float


@dataclass(frozen=True, repr=False)
class Solution:
    """A verified plan. What is not solved is an exception, never a solution.

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

    problem: Problem
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

    @property
    def joint_positions(self) -> FloatArray:
        """Joint and tip positions at every sample, shape (T, links + 1, d) [m]."""
        return self.problem.arm.joint_positions_at(self.trajectory.positions)

    @property
    def least_gap(self) -> float | None:
        """Least gap of the motion beyond radius and clearance [m]; None where nobody measured it."""
        return None if self.room is None or not self.room.nearest.link else self.room.nearest.gap

    @property
    def goal_errors(self) -> GoalErrors:
        """How the last link lies at the end of a motion in space."""
        return goal_errors(self.problem, self.trajectory.positions[-1])

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


def goal_errors(problem: Problem, last: FloatArray) -> GoalErrors:
    """How the last link lies against the goal of a problem in a configuration, shape (c,) [rad, m]."""
    arm = problem.arm
    turn = arm.link_rotations(last)[-1]
    roll = roll_against(arm.base_rotation, turn)
    if not isinstance(problem.goal, TipGoal):
        return GoalErrors(None, None, roll)
    off = float(np.linalg.norm(arm.joint_positions_at(last)[-1] - problem.goal.position))
    wanted = problem.goal.direction
    return GoalErrors(off, None if wanted is None else angle_between(turn[:, 0], wanted), roll)


def angle_between(first: FloatArray, second: FloatArray) -> float:
    """The angle between two vectors, shape (3,), exact for small ones too [rad]."""
    return float(np.arctan2(np.linalg.norm(np.cross(first, second)), first @ second))


def roll_against(base: FloatArray, turn: FloatArray) -> float:
    """Turn about x of a frame against another one that is turned to its x by the shortest turn [rad].

    Args:
        base: the other frame, its axes as columns, shape (3, 3).
        turn: the frame, likewise.
    """
    start = base[:, 0]
    end = turn[:, 0]
    axis = np.cross(start, end)
    cos = float(start @ end)
    if 1.0 + cos < np.finfo(np.float64).eps:
        # Every half turn is as short as any other: that about the base's z axis is taken.
        moved = 2.0 * np.outer(base[:, 2], base[:, 2]) @ base - base
    else:
        cross = np.cross(np.eye(3), axis)  # the matrix of x ↦ axis × x
        moved = base + cross @ base + cross @ cross @ base / (1.0 + cos)
    return float(np.arctan2(turn[:, 1] @ moved[:, 2], turn[:, 1] @ moved[:, 1]))
