"""Solutions: a verified motion, a pose that was asked for, and plans along a Pareto front."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from html import escape
from pathlib import Path
from typing import Any, Protocol, Self

import numpy as np

from ccm_opt.core.arrays import BoolArray, FloatArray
from ccm_opt.core.length_words import short_length, words_in
from ccm_opt.problem import JointPose, Problem
from ccm_opt.problem.solution.records import GoalPoseRecord, RoomRecord, SurvivedError, TryRecord
from ccm_opt.problem.solution.stage_results import Check, JointPath, JointStates, JointTrajectory, SimulatedMotion
from ccm_opt.robot.configuration import Curve


class Presenter(Protocol):
    """Draws, animates and saves plans."""

    def plot(self, plan: Any) -> Any:
        """Return a figure of a plan."""
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
    """Return who draws and saves plans.

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
        """Return a table for notebooks: the checks with their worst values and limits."""
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
        """Return the same plan with another record of its room."""
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
    """Return how the last link lies against the goal of a problem in a configuration, shape (c,) [rad, m]."""
    arm = problem.arm
    turn = arm.link_rotations(last)[-1]
    roll = roll_against(arm.base_rotation, turn)
    goal = problem.goal.for_tip
    if goal is None:
        return GoalErrors(None, None, roll)
    off = float(np.linalg.norm(arm.joint_positions_at(last)[-1] - goal.position))
    wanted = goal.direction
    return GoalErrors(off, None if wanted is None else angle_between(turn[:, 0], wanted), roll)


def angle_between(first: FloatArray, second: FloatArray) -> float:
    """Return the angle between two vectors, shape (3,), exact for small ones too [rad]."""
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


@dataclass(frozen=True)
class BindingSide:
    """A side of a link's region that a pose leans on: with the side farther away the pose would cost less.

    Attributes:
        link: number of the link, from 1 at the base.
        place: the end of the link that leans on it, shape (d,) [m].
        towards: unit normal of the side, from the link outwards.
        multiplier: how much the objective would fall for one arm's length.
    """

    link: int
    place: tuple[float, ...]
    towards: tuple[float, ...]
    multiplier: float


@dataclass(frozen=True)
class PoseOutcome:
    """What came of one beginning from which a pose at the goal was looked for.

    Attributes:
        start: where the search began, in words.
        cost: of the pose found; None when none was.
        gap: its least room beyond radius and clearance, at most the wanted gap [m]; likewise.
        reason: why there is none; empty when there is one.
    """

    start: str
    cost: float | None = None
    gap: float | None = None
    reason: str = ""


@dataclass(frozen=True, eq=False)
class StaticPose:
    """The best pose that was found at a problem's goal, whatever motion would lead to it.

    Attributes:
        problem: what was asked.
        pose: what the NLP said about the pose.
        configuration: the pose itself, shape (c,) [rad, m].
        curve: the curve that its links follow: a ``Configuration`` in the plane, a ``SpaceConfiguration`` in space.
        nearest: link and obstacle, or two links, that are nearest to each other, with their gap, in words.
        residuals: by how much the pose misses each of the user's constraints at the goal, soft ones too, by name.
        outcomes: of every beginning, the best first; the pose is that of the first.
        timings: CPU time of every stage [s].
        binding: sides of regions that the pose leans on, the largest multiplier first.
    """

    problem: Problem
    pose: GoalPoseRecord
    configuration: FloatArray
    curve: Curve
    nearest: str
    residuals: Mapping[str, float]
    outcomes: tuple[PoseOutcome, ...]
    timings: Mapping[str, float]
    binding: tuple[BindingSide, ...] = ()

    @property
    def bends(self) -> FloatArray:
        """Bends of every joint, shape (links,), in space (links, 2) [rad]."""
        return JointPose.from_configuration(self.configuration, self.problem.arm.coordinates).bends

    @property
    def feed(self) -> float:
        """Where the base is on its feed axis [m]; 0 without one."""
        return float(self.problem.arm.coordinates.advance(self.configuration))

    @property
    def joint_positions(self) -> FloatArray:
        """Positions of the joints and the tip, shape (links + 1, d) [m]."""
        return self.problem.arm.joint_positions_at(self.configuration)

    @property
    def goal_errors(self) -> GoalErrors:
        """How the last link lies at the goal in space."""
        return goal_errors(self.problem, self.configuration)


@dataclass(frozen=True, eq=False)
class ReachMap:
    """For each cell of a grid whether a pose was found with the tip in its middle, and which ways the link can point.

    Cells are counted by rows and columns in the plane, N = (ny, nx), and along the axes in space, N = (nx, ny, nz).

    Attributes:
        problem: arm and scene.
        step: width of a cell [m].
        axes: middles of the cells along x and y, in space along z too [m].
        headings: of the last link that were tried in the plane, increasing, shape (K,) [rad]; none in space.
        directions: of the last link that were tried in space, unit vectors, shape (K, 3); none in the plane.
        reachable: whether a pose was found, with any heading or direction, shape N.
        taken: whether one was found with each heading or direction, shape (..., K).
        gap: largest room beyond radius and clearance of any pose found in the cell, as far as it was looked at, shape N
            [m]; NaN where there is none.
        proved: whether it is proved that no pose exists, shape N; elsewhere nothing is known where none was found.
        seen: room above which gaps are not told apart [m].
        timings: CPU time by stage, of this process and of the workers [s].
    """

    problem: Problem
    step: float
    axes: tuple[FloatArray, ...]
    headings: FloatArray
    directions: FloatArray
    reachable: BoolArray
    taken: BoolArray
    gap: FloatArray
    proved: BoolArray
    seen: float
    timings: Mapping[str, float]

    @property
    def size(self) -> float:
        """Area of the cells in which a pose was found [m²], in space their volume [m³]."""
        return float(self.reachable.sum()) * self.step ** len(self.axes)

    @property
    def places(self) -> FloatArray:
        """Middles of all cells in space, shape (nx, ny, nz, 3) [m]."""
        return np.stack(np.meshgrid(*self.axes, indexing="ij"), axis=-1)

    @cached_property
    def heading_ranges(self) -> FloatArray:
        """Runs of neighbouring headings that were taken, shape (R, 4).

        Each has the number of the row, that of the column, and the first and last heading [rad]. A run over 360° ends
        beyond it, and one all round has a whole turn.
        """
        ranges = [
            (float(row), float(column), first, last)
            for row, column in np.argwhere(self.taken.any(axis=2))
            for first, last in _runs(self.headings, self.taken[row, column])
        ]
        return np.array(ranges).reshape(-1, 4)


def _runs(headings: FloatArray, taken: BoolArray) -> list[tuple[float, float]]:
    """Return the first and last heading of every run, round the whole turn."""
    count = len(taken)
    turn = 2.0 * np.pi
    if taken.all():
        return [(float(headings[0]), float(headings[0]) + turn)]
    starts = [k for k in range(count) if taken[k] and not taken[k - 1]]
    runs = []
    for start in starts:
        length = 0
        while taken[(start + length) % count]:
            length += 1
        last = start + length - 1
        runs.append((float(headings[start]), float(headings[last % count]) + turn * (last // count)))
    return runs


@dataclass(frozen=True, eq=False)
class ParetoPlan:
    """A plan for one wanted gap.

    Attributes:
        wanted_gap: that was asked for [m].
        solution: verified, with its room and its price; None when there is none.
        reason: why there is none; empty when there is one.
        cpu: CPU time of planning, timing and verification [s].
        dominated_by: number from 1 of a plan that is no slower and has no less room, and more of one of them; 0 when
            there is none.
    """

    wanted_gap: float
    solution: Solution | None
    reason: str = ""
    cpu: float = 0.0
    dominated_by: int = 0

    @property
    def duration(self) -> float:
        """Of the motion [s]; inf without one."""
        return np.inf if self.solution is None else self.solution.trajectory.duration

    @property
    def gap(self) -> float:
        """Least gap of the motion beyond radius and clearance [m]; -inf without one."""
        if self.solution is None or self.solution.room is None:
            return -np.inf
        return self.solution.room.nearest.gap

    @property
    def energy(self) -> float:
        """Work that the drives do and take back, the integral of effort times speed without its sign [J].

        Infinite without a motion.
        """
        if self.solution is None:
            return np.inf
        joints = self.solution.joints
        trajectory = self.solution.trajectory
        power = np.abs(joints.torques * joints.velocities).sum(axis=1)
        power = power + np.abs(joints.base_forces * trajectory.base_velocities).sum(axis=1)
        return float(np.trapezoid(power, trajectory.time))

    @property
    def peak_torque(self) -> float:
        """Largest torque of any joint [N m]; inf without a motion."""
        return np.inf if self.solution is None else float(np.max(np.abs(self.solution.joints.torques), initial=0.0))


@dataclass(frozen=True, eq=False)
class ParetoPlans:
    """The trade-off between time and room.

    Attributes:
        problem: what was asked.
        plans: in the order of their wanted gaps, the first without one.
        recommended: number from 1 of the plan to run.
        most_time: share by which that plan may be slower than the fastest.
    """

    problem: Problem
    plans: tuple[ParetoPlan, ...]
    recommended: int
    most_time: float

    @property
    def best(self) -> Solution:
        """The plan to run."""
        solution = self.plans[self.recommended - 1].solution
        if solution is None:
            raise ValueError("no plan is recommended")
        return solution

    @property
    def fastest(self) -> float:
        """The shortest duration [s]."""
        return min(plan.duration for plan in self.plans)
