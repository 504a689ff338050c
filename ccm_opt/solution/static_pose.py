"""Results of a pose at the goal and of a reach map."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ccm_opt.core.arrays import BoolArray, FloatArray
from ccm_opt.problem import Problem
from ccm_opt.solution.records import GoalPoseRecord


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
        pose: the pose, its curve, and what the NLP said about it.
        nearest: link and wall, or two links, that are nearest to each other, with their gap, in words.
        binding: sides of regions that the pose leans on, the largest multiplier first.
        residuals: by how much the pose misses each of the user's constraints at the goal, soft ones too, by name.
        outcomes: of every beginning, the best first; the pose is that of the first.
        timings: CPU time of every stage [s].
    """

    problem: Problem
    pose: GoalPoseRecord
    nearest: str
    binding: tuple[BindingSide, ...]
    residuals: Mapping[str, float]
    outcomes: tuple[PoseOutcome, ...]
    timings: Mapping[str, float]

    @property
    def bends(self) -> FloatArray:
        """Of the joints, the first against the base heading, shape (links,) [rad]."""
        return self.problem.arm.bends(self.pose.headings)

    @property
    def joint_positions(self) -> FloatArray:
        """Positions of the joints and the tip, shape (links + 1, 2) [m]."""
        return self.problem.arm.joint_positions(self.pose.headings)


@dataclass(frozen=True, eq=False)
class ReachMap:
    """For each cell of a grid whether a pose was found with the tip in its middle, and with which headings.

    Attributes:
        problem: arm and room.
        step: width of a cell [m].
        x: middles of the columns, shape (nx,) [m].
        y: middles of the rows, shape (ny,) [m].
        headings: of the last link that were tried, increasing, shape (K,) [rad].
        reachable: whether a pose was found, with any heading, shape (ny, nx).
        taken: whether one was found with each heading, shape (ny, nx, K).
        gap: largest room beyond radius and clearance of any pose found in the cell, as far as it was looked at, shape
            (ny, nx) [m]; NaN where there is none.
        proved: whether it is proved that no pose exists, shape (ny, nx); elsewhere nothing is known where none was
            found.
        seen: room above which gaps are not told apart [m].
        timings: CPU time by stage, of this process and of the workers [s].
    """

    problem: Problem
    step: float
    x: FloatArray
    y: FloatArray
    headings: FloatArray
    reachable: BoolArray
    taken: BoolArray
    gap: FloatArray
    proved: BoolArray
    seen: float
    timings: Mapping[str, float]

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

    @property
    def area(self) -> float:
        """Of the cells in which a pose was found [m²]."""
        return float(self.reachable.sum()) * self.step**2


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
