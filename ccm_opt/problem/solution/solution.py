"""Results returned to the user: a verified plan, a static pose, a reachability map, and Pareto-optimal plans."""

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
from ccm_opt.problem.solution.records import ClearanceRecord, GoalPoseRecord, ToleratedError, TryRecord
from ccm_opt.problem.solution.stage_results import Check, JointPath, JointStates, JointTrajectory, SimulatedMotion
from ccm_opt.problem.solution.tour import Tour
from ccm_opt.robot.configuration import Curve


class Presenter(Protocol):
    """Interface of objects that draw, animate and save plans, through which this package avoids importing plotting."""

    def plot(self, plan: Any) -> Any:
        """Return a matplotlib figure of the scene, the arm at several times, and the path of its tip."""
        ...

    def animate(self, plan: Any, file: str | Path) -> Path:
        """Write a video of a plan to ``file`` and return its path."""
        ...

    def report(self, plan: Any, file: str | Path) -> Path:
        """Write the HTML report of a plan to ``file`` and return its path."""
        ...

    def save(self, solution: Any, folder: str | Path) -> Path:
        """Write the output folder of a solution and return its path."""
        ...


_PRESENTERS: list[Presenter] = []
"""Registered presenters (objects that draw and save plans); the last one is used."""


def present_with(presenting: Presenter) -> None:
    """Register the object that draws, animates and saves plans from now on."""
    _PRESENTERS.append(presenting)


def presenter() -> Presenter:
    """Return the object registered last for drawing, animating and saving plans.

    Raises:
        RuntimeError: none is registered; importing ``solve`` or ``Solution`` from ``ccm_opt`` registers one.
    """
    if not _PRESENTERS:
        raise RuntimeError("drawing and saving are not loaded; import ccm_opt.viz.saved_plans first")
    return _PRESENTERS[-1]


@dataclass(frozen=True)
class GoalErrors:
    """Deviation of the last link from the goal at the end of a motion in space.

    Attributes:
        position: distance of the tip from the goal position [m]; None for a goal of joint angles.
        direction: angle between the last link and the required direction [rad]; None if any direction is allowed.
        roll: rotation of the last link about its axis [rad], measured from the base frame after the smallest rotation
            that aligns the frame's x axis with the link; it follows from the joint angles.
        roll_error: roll about the goal's direction away from its up direction [rad]; None if any roll is allowed.
    """

    position: float | None
    direction: float | None
    roll: float
    roll_error: float | None = None


@dataclass(frozen=True, repr=False)
class Solution:
    """A verified plan: path, trajectory, simulation and checks.

    A problem that is not solved raises an exception instead.

    Attributes:
        problem: the problem solved.
        path: the untimed path.
        trajectory: the timed motion.
        joints: states of all revolute joints over the motion, with efforts.
        simulation: motion of the simulated arm.
        checks: checks of the verifier, then of the user's constraints, all passed.
        metrics: figures of merit, by names that end in their unit.
        timings: CPU time of each stage, by stage name [s].
        versions: versions of Python and of the packages used, by name.
        room: clearance of the motion over time; None if not requested.
        tolerance: errors that the motion tolerates; empty if not requested.
        tries: outcome of every planning attempt, if several were requested; else empty.
        tour: order in which goals in free order are visited, those that are left out, and the problem as posed, of
            which ``problem`` then has the goals that are visited; None for goals in given order.
        not_checked: properties that a reader might expect to be checked but that were not, in words; usually empty.
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
    room: ClearanceRecord | None = None
    tolerance: tuple[ToleratedError, ...] = ()
    tries: tuple[TryRecord, ...] = ()
    not_checked: tuple[str, ...] = ()
    tour: Tour | None = None

    def __repr__(self) -> str:
        gap = self.metrics.get("least_wall_clearance_m", np.inf)
        with words_in(self.problem.length_unit):
            near = f", wall clearance at least {short_length(gap)}" if np.isfinite(gap) else ""
        motion = f"{self.problem.arm.links} links, {self.trajectory.duration:.2f} s{near}"
        return f"<{type(self).__name__} of '{self.problem.name}': {motion}, {len(self.checks)} checks hold>"

    def _repr_html_(self) -> str:
        """Return an HTML table of the checks, with worst values and limits, for notebooks."""
        cells = [
            f"<tr><td>{escape(check.name)}</td><td>{check.worst:.3g} {escape(check.unit)}</td>"
            f"<td>{check.limit:.3g}</td><td>{escape(check.where)}</td></tr>"
            for check in self.checks
        ]
        head = "<tr><th>check</th><th>worst</th><th>limit</th><th>where</th></tr>"
        return f"<p>{escape(repr(self)[1:-1])}</p><table>{head}{''.join(cells)}</table>"

    @property
    def joint_positions(self) -> FloatArray:
        """Positions of joints and tip of n links at T samples, shape (T, n + 1, d) with d = 2 or 3 [m]."""
        return self.problem.arm.joint_positions_at(self.trajectory.positions)

    @property
    def least_gap(self) -> float | None:
        """Minimum clearance beyond the required one [m]; None if not measured, or nothing is in the search distance."""
        return None if self.room is None or not self.room.nearest.link else self.room.nearest.gap

    @property
    def goal_errors(self) -> GoalErrors:
        """Deviation of the last link from the goal at the end of a motion in space."""
        return goal_errors(self.problem, self.trajectory.positions[-1])

    def with_clearance_record(self, room: ClearanceRecord) -> Self:
        """Return a copy of this plan with the given record of clearance over time."""
        return replace(self, room=room)

    def plot(self) -> Any:
        """Return a matplotlib figure of the plan, see ``ccm_opt.plot``."""
        return presenter().plot(self)

    def animate(self, file: str | Path) -> Path:
        """Write a video of the plan, see ``ccm_opt.animate``."""
        return presenter().animate(self, file)

    def report(self, file: str | Path) -> Path:
        """Write the HTML report of the plan, see ``ccm_opt.report``."""
        return presenter().report(self, file)

    def save(self, folder: str | Path) -> Path:
        """Save the plan to a folder, see ``ccm_opt.save``."""
        return presenter().save(self, folder)


def goal_errors(problem: Problem, last: FloatArray) -> GoalErrors:
    """Return the deviation of the last link, or the tool, from the goal, for an arm in space in a given configuration.

    Args:
        problem: the problem.
        last: configuration with c coordinates, shape (c,) [rad, m].
    """
    arm = problem.arm
    turn = arm.link_rotations(last)[-1]
    roll = roll_against(arm.base_rotation, turn)
    goal = problem.goal.for_tip
    if goal is None or goal.look_at is not None:
        return GoalErrors(None, None, roll)
    tip, along = arm.joint_positions_at(last)[-1], turn @ arm.ahead_in_last_link
    if arm.tool is not None:
        tip = tip + turn @ arm.tool.tip
    off = float(np.linalg.norm(tip - goal.position))
    rolled = None if goal.up is None else abs(goal.roll_of(turn @ arm.tip_up))
    return GoalErrors(off, None if goal.direction is None else angle_between(along, goal.direction), roll, rolled)


def angle_between(first: FloatArray, second: FloatArray) -> float:
    """Return the angle between two vectors of shape (3,) [rad], accurate for small angles too."""
    return float(np.arctan2(np.linalg.norm(np.cross(first, second)), first @ second))


def roll_against(base: FloatArray, turn: FloatArray) -> float:
    """Return the roll of a frame about its own x axis, relative to a base frame [rad].

    The base frame is first turned by the shortest rotation that aligns its x axis with that of the frame; the roll is
    the remaining angle about this axis.

    Args:
        base: axes of the base frame as columns, shape (3, 3).
        turn: axes of the frame as columns, shape (3, 3).
    """
    start = base[:, 0]
    end = turn[:, 0]
    axis = np.cross(start, end)
    cos = float(start @ end)
    if 1.0 + cos < np.finfo(np.float64).eps:
        # The x axes are opposite and every half turn is equally short: take the one about the base's z axis.
        moved = 2.0 * np.outer(base[:, 2], base[:, 2]) @ base - base
    else:
        cross = np.cross(np.eye(3), axis)  # the matrix of x ↦ axis × x
        moved = base + cross @ base + cross @ cross @ base / (1.0 + cos)
    return float(np.arctan2(turn[:, 1] @ moved[:, 2], turn[:, 1] @ moved[:, 1]))


@dataclass(frozen=True)
class BindingSide:
    """An active side of the convex region that contains a link in a pose.

    Attributes:
        link: number of the link, from 1 at the base.
        place: end of the link that touches the side, 2 or 3 coordinates [m].
        towards: unit normal of the side, pointing out of the region.
        multiplier: Lagrange multiplier: rate at which the cost decreases as the side moves outward, per arm length.
    """

    link: int
    place: tuple[float, ...]
    towards: tuple[float, ...]
    multiplier: float


@dataclass(frozen=True)
class PoseOutcome:
    """The outcome of the search for a goal pose from one initial guess.

    Attributes:
        start: the initial guess, in words.
        cost: cost of the pose found; None if none was found.
        gap: minimum clearance of the pose beyond the required clearance, capped at the preferred clearance [m]; None
            if no pose was found.
        reason: reason why no pose was found; empty if one was found.
    """

    start: str
    cost: float | None = None
    gap: float | None = None
    reason: str = ""


@dataclass(frozen=True, eq=False)
class StaticPose:
    """The best pose found at a problem's goal, without regard to a motion that leads to this pose.

    Attributes:
        problem: the problem, which gives arm, scene and goal.
        pose: solution of the nonlinear program for the pose.
        configuration: the pose as a configuration with c coordinates, shape (c,) [rad, m].
        curve: backbone curve that the links follow: a ``Configuration`` in the plane, a ``SpaceConfiguration`` in
            space. Where drives move several joints, or links carry bodies, it is only fitted to the bends.
        nearest: the two bodies with the minimum clearance, and this clearance, in words.
        residuals: violation of each of the user's hard and soft constraints, by name.
        outcomes: outcome of every initial guess, the best first, which gives the pose.
        timings: CPU time of each stage, by stage name [s].
        binding: active sides of the convex regions that contain the links, the largest multiplier first.
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
        """Bend angles of the joints of n links, shape (n,), in space (n, 2) [rad]."""
        return JointPose.from_configuration(self.configuration, self.problem.arm.coordinates).bends

    @property
    def feed(self) -> FloatArray | float:
        """Position of the base on its feed axis [m], or of the k axes that carry it, shape (k,) [m, rad]; 0 without."""
        return JointPose.from_configuration(self.configuration, self.problem.arm.coordinates).feed

    @property
    def joint_positions(self) -> FloatArray:
        """Positions of joints and tip of n links, shape (n + 1, d) with d = 2 or 3 [m]."""
        return self.problem.arm.joint_positions_at(self.configuration)

    @property
    def goal_errors(self) -> GoalErrors:
        """Deviation of the last link from the goal, for an arm in space."""
        return goal_errors(self.problem, self.configuration)


@dataclass(frozen=True, eq=False)
class ReachMap:
    """A reachability map: for each cell of a grid, whether the tip can reach the centre, and in which directions.

    Cells are indexed by rows and columns in the plane, N = (ny, nx), and along the axes in space, N = (nx, ny, nz).

    Attributes:
        problem: the problem that gives arm and scene.
        step: width of a cell [m].
        axes: cell centres along x and y, in space along z too [m].
        headings: headings of the last link that were tried in the plane, increasing, shape (K,) [rad]; empty in space.
        directions: directions of the last link that were tried in space, unit vectors, shape (K, 3); empty in the
            plane.
        reachable: whether a pose was found with any heading or direction, shape N.
        taken: whether a pose was found with each heading or direction, shape ``(*N, K)``.
        gap: maximum clearance, beyond the required clearance, of any pose found in the cell, capped at ``seen``, shape
            N [m]; NaN where no pose was found.
        proved: whether it is proved that no pose exists, shape N; other cells without a pose are undecided.
        seen: search distance, at which clearances are capped [m].
        timings: CPU time of each stage, by stage name, in this process and in worker processes [s].
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
        """Total area of the reachable cells [m²], in space their volume [m³]."""
        return float(self.reachable.sum()) * self.step ** len(self.axes)

    @property
    def places(self) -> FloatArray:
        """Centres of all cells of a map in space, shape (nx, ny, nz, 3) [m]."""
        return np.stack(np.meshgrid(*self.axes, indexing="ij"), axis=-1)

    @cached_property
    def heading_ranges(self) -> FloatArray:
        """Ranges of consecutive reachable headings in all cells of a planar map, R ranges, shape (R, 4).

        Each row holds the cell's row and column, and the first and last heading [rad]. The end of a range that wraps
        around is increased by a full turn; a range of all headings is a full turn long.
        """
        ranges = [
            (float(row), float(column), first, last)
            for row, column in np.argwhere(self.taken.any(axis=2))
            for first, last in _runs(self.headings, self.taken[row, column])
        ]
        return np.array(ranges).reshape(-1, 4)


def _runs(headings: FloatArray, taken: BoolArray) -> list[tuple[float, float]]:
    """Return the first and last heading of every range of consecutive reachable headings, on the full circle [rad].

    Args:
        headings: headings tried, increasing, shape (K,) [rad].
        taken: whether a pose was found with each heading, shape (K,).
    """
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
    """The plan for one value of the preferred clearance.

    Attributes:
        wanted_gap: preferred clearance beyond the required clearance [m].
        solution: verified plan, with its clearance over time and the price of this clearance; None if no plan was
            found.
        reason: reason why no plan was found; empty if one was found.
        cpu: CPU time of planning, timing and verification [s].
        dominated_by: number, from 1, of a plan that is no worse in duration and minimum clearance, and better in one of
            them; 0 if there is no such plan.
    """

    wanted_gap: float
    solution: Solution | None
    reason: str = ""
    cpu: float = 0.0
    dominated_by: int = 0

    @property
    def duration(self) -> float:
        """Duration of the motion [s]; inf if no plan was found."""
        return np.inf if self.solution is None else self.solution.trajectory.duration

    @property
    def gap(self) -> float:
        """Minimum clearance of the motion beyond the required clearance [m]; -inf if no plan was found."""
        if self.solution is None or self.solution.room is None:
            return -np.inf
        return self.solution.room.nearest.gap

    @property
    def energy(self) -> float:
        """Energy exchanged by the drives, the time integral of ``|effort × velocity|`` [J]; inf without a plan."""
        if self.solution is None:
            return np.inf
        joints = self.solution.joints
        trajectory = self.solution.trajectory
        power = np.abs(joints.torques * joints.velocities).sum(axis=1)
        power = power + np.abs(joints.base_forces * trajectory.base_velocities).sum(axis=1)
        return float(np.trapezoid(power, trajectory.time))

    @property
    def peak_torque(self) -> float:
        """Maximum torque of any joint over the motion [N m]; inf if no plan was found."""
        return np.inf if self.solution is None else float(np.max(np.abs(self.solution.joints.torques), initial=0.0))


@dataclass(frozen=True, eq=False)
class ParetoPlans:
    """Plans of one problem for several preferred clearances: the trade-off between duration and clearance.

    Attributes:
        problem: the problem solved.
        plans: plans in increasing order of preferred clearance, the first without preferred clearance.
        recommended: number, from 1, of the recommended plan.
        most_time: fraction by which the recommended plan may take longer than the fastest plan.
    """

    problem: Problem
    plans: tuple[ParetoPlan, ...]
    recommended: int
    most_time: float

    @property
    def best(self) -> Solution:
        """The recommended plan.

        Raises:
            ValueError: the recommended entry has no plan.
        """
        solution = self.plans[self.recommended - 1].solution
        if solution is None:
            raise ValueError("no plan is recommended")
        return solution

    @property
    def fastest(self) -> float:
        """Shortest duration of any plan [s]."""
        return min(plan.duration for plan in self.plans)
