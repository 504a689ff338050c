"""Results of a pose at the goal and of a reach map."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ccm_opt.core.arrays import BoolArray, FloatArray
from ccm_opt.problem import JointPose, Problem
from ccm_opt.robot.configuration import Curve
from ccm_opt.solution.records import EndRecord
from ccm_opt.solution.solution import GoalErrors, goal_errors


@dataclass(frozen=True)
class BindingSide:
    """A side of a link's region that a pose leans on: with the side farther away the pose would cost less.

    Attributes:
        link: number of the link, from 1 at the base.
        place: the end of the link that leans on it, (x, y) [m].
        towards: unit normal of the side, from the link outwards.
        multiplier: how much the objective would fall for one arm's length.
    """

    link: int
    place: tuple[float, float]
    towards: tuple[float, float]
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
        binding: sides of regions that the pose leans on in the plane, the largest multiplier first.
    """

    problem: Problem
    pose: EndRecord
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
        taken: whether one was found with each heading or direction, shape (*N, K).
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
    """First and last heading of every run, round the whole turn."""
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
