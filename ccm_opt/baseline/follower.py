"""Makes an arm follow the curve of a hill climber.

The arm takes the mean heading of the curve on each link plus what the start's own mapping adds, so that the first
keyframe is the start itself. Tips and contacts are those of the arm.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import shapely
from scipy.ndimage import map_coordinates

from ccm_opt.baseline.candidate_moves import Shapes
from ccm_opt.baseline.settings import DEFAULT_BASELINE, BaselineSettings
from ccm_opt.baseline.world import World
from ccm_opt.core.arrays import BoolArray, FloatArray
from ccm_opt.core.deadline import Deadline
from ccm_opt.errors import Diagnosis, ProblemError, TimeLimitReached
from ccm_opt.planning.ends import Ends, resolve_ends
from ccm_opt.planning.pose import nearest_curve
from ccm_opt.problem import CurvePose, Problem
from ccm_opt.robot.configuration import Configuration
from ccm_opt.robot.decomposition import merge_segments
from ccm_opt.scene.certificate import Certificate
from ccm_opt.scene.free_space import FreeSpace
from ccm_opt.scene.workspace import Workspace

_FIELD_CELLS = 160
"""Cells of the grid of distances along the longer side of the room. Taste."""
_JOINT_LIMIT_SHARE = 0.99
"""Share of the joint limits that moves use; the smooth path near them bends a little more. Taste."""
_MERGING_TOLERANCE = 0.02
"""How far headings may move when segments of the start are merged [rad]; the follower's offset makes up for it exactly.
Taste."""


@dataclass(frozen=True)
class ClearanceField:
    """Distance of places from the nearest wall, less what the arm needs.

    Attributes:
        corner: of the grid, shape (2,) [m].
        cell: size of a cell [m].
        gaps: at the grid's nodes, shape (columns, rows) [m].
    """

    corner: FloatArray
    cell: float
    gaps: FloatArray

    @classmethod
    def from_workspace(cls, workspace: Workspace, need: float, cells: int = _FIELD_CELLS) -> "ClearanceField":
        """The field of a room, ``cells`` along its longer side, for an arm that needs a distance ``need`` [m]."""
        xmin, ymin, xmax, ymax = workspace.boundary.bounds
        cell = max(xmax - xmin, ymax - ymin) / cells
        x = np.arange(xmin, xmax + cell, cell)
        y = np.arange(ymin, ymax + cell, cell)
        nodes = np.asarray(shapely.points(*np.meshgrid(x, y, indexing="ij")))
        gaps = np.full(nodes.shape, np.inf)
        for wall in workspace.walls:
            np.minimum(gaps, shapely.distance(nodes, wall.core) - wall.rounding, out=gaps)
        return cls(np.array([xmin, ymin]), cell, gaps - need)

    def gap(self, points: FloatArray) -> FloatArray:
        """Interpolated gaps at points (..., 2) [m]; shape (...). Places outside the room take those at its edge."""
        places = np.moveaxis((points - self.corner) / self.cell, -1, 0)
        gaps: FloatArray = map_coordinates(self.gaps, places, order=1, mode="nearest")
        return gaps


@dataclass(frozen=True)
class Follower:
    """The jointed arm as it follows curves.

    Attributes:
        problem: with the arm and its workspace.
        ends: start and goal on the links.
        certificate: of moves.
        deadline: when to stop.
        settings: the planner's.
    """

    problem: Problem
    ends: Ends
    certificate: Certificate
    deadline: Deadline
    settings: BaselineSettings = DEFAULT_BASELINE

    @classmethod
    def from_problem(cls, problem: Problem, settings: BaselineSettings = DEFAULT_BASELINE) -> "Follower":
        """The arm of a problem, with its share of the problem's time from now on.

        Args:
            problem: to plan for.
            settings: the planner's.

        Raises:
            UnreachableGoal: start or goal cannot be.
        """
        ends = resolve_ends(problem)
        deadline = Deadline.after(settings.planning_share * problem.planner.time_limit)
        return cls(problem, ends, _certificate(problem, ends, settings), deadline, settings)

    @cached_property
    def start(self) -> Configuration:
        """The curve at the start, with as few segments as follow it."""
        pose = self.problem.start
        curve = pose.configuration if isinstance(pose, CurvePose) else nearest_curve(self.problem.arm, self.ends.start)
        return _with_few_segments(curve, _MERGING_TOLERANCE)

    @cached_property
    def offset(self) -> FloatArray:
        """What the start's mapping adds to mean headings, shape (links,) [rad]."""
        mean_headings = Shapes.from_configurations([self.start]).mean_headings(self.problem.arm.links)[0]
        offset: FloatArray = self.ends.start - mean_headings
        return offset

    def headings(self, shapes: Shapes) -> FloatArray:
        """Link headings, shape (m, links) [rad]."""
        return shapes.mean_headings(self.problem.arm.links) + self.offset

    def tips(self, shapes: Shapes) -> tuple[FloatArray, FloatArray]:
        """Positions (m, 2) [m] and headings (m,) [rad] of the arm's tips."""
        headings = self.headings(shapes)
        return self.problem.arm.joint_positions(headings)[:, -1], headings[:, -1]

    def passes(self, here: Shapes, there: Shapes) -> BoolArray:
        """Which moves keep the joint limits and touch nothing on the way.

        Args:
            here: one curve, where the arm is.
            there: m curves to move to.

        Returns:
            Shape (m,).

        Raises:
            TimeLimitReached: the deadline has passed.
        """
        look_at_clock(self.deadline)
        arm = self.problem.arm
        headings = self.headings(there)
        limits = _JOINT_LIMIT_SHARE * arm.bend_limits
        allowed: BoolArray = np.all(np.abs(arm.bends(headings)) <= limits, axis=1)
        if allowed.any():
            # One call of the certificate for all moves: here, there, here, there, ... The odd intervals are the ways
            # back from a candidate to the start, which nobody asks about.
            keyframes = np.repeat(headings[allowed], 2, axis=0)
            keyframes[::2] = self.headings(here)[0]
            failing = self.certificate.failures(keyframes, self.settings.bisections)
            blocked = failing[failing % 2 == 0] // 2
            allowed[np.flatnonzero(allowed)[blocked]] = False
        return allowed

    @cached_property
    def field(self) -> ClearanceField:
        """Gaps in the workspace."""
        return ClearanceField.from_workspace(
            self.problem.workspace, self.problem.arm.radius + self.problem.workspace.clearance
        )

    @cached_property
    def free_space(self) -> FreeSpace:
        """Free space of the arm's axis."""
        arm = self.problem.arm
        need = arm.radius + self.problem.workspace.clearance
        return FreeSpace(self.problem.workspace, need + self.settings.route_inflation * arm.length)

    @property
    def hurried_world(self) -> World:
        """The world of the schemas for one plan, whose share of the time that is left begins now."""
        # Of the time that is left now, so that late plans have less but every one has some.
        until = Deadline.after(self.settings.plan_share * self.deadline.left)

        def passes(here: Shapes, there: Shapes) -> BoolArray:
            look_at_clock(until)
            return self.passes(here, there)

        return replace(self.world, passes=passes)

    @property
    def world(self) -> World:
        """The world of the schemas."""
        arm = self.problem.arm
        if self.ends.clamped:  # the base stands flush on a wall
            base_range = (self.start.base_heading, self.start.base_heading)
        else:
            base_range = (arm.base_heading - arm.base_limit, arm.base_heading + arm.base_limit)
        return World(
            passes=self.passes,
            tips=self.tips,
            gap=self.field.gap,
            curvature_limit=arm.joint_limit / arm.link_length,
            thickness=2.0 * arm.radius if arm.self_collision else 0.0,
            base_range=base_range,
            settings=self.settings.climbing,
        )


def look_at_clock(deadline: Deadline) -> None:
    """Do nothing before a deadline.

    Raises:
        TimeLimitReached: after it.
    """
    if deadline.passed():
        raise TimeLimitReached(Diagnosis(deadline.what_passed(), "hill climbing", ("raise planner.time_limit",)))


def _certificate(problem: Problem, ends: Ends, settings: BaselineSettings) -> Certificate:
    """A little more than contact where the start has it; a start that touches something must be allowed to leave."""
    with_gap = Certificate(problem.arm, problem.workspace, settings.certified_gap * problem.arm.length)
    standing_still = np.stack((ends.start, ends.start))
    if len(with_gap.failures(standing_still)) == 0:
        return with_gap
    return Certificate(problem.arm, problem.workspace)


def _with_few_segments(configuration: Configuration, tolerance: float) -> Configuration:
    """The same curve, headings to within a tolerance [rad], with neighbours merged from the base on.

    Every segment multiplies the moves that a climb has to try, so each one less is worth its error.
    """
    k = 0
    while k < len(configuration.segments) - 1:
        try:
            configuration = merge_segments(configuration, k, tolerance)
        except ProblemError:
            k += 1
    return configuration
