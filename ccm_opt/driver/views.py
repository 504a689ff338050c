"""Goals of looking at a place: tip poses from which it is seen, and planning to one that the arm can reach.

All tip poses from which a place is seen form a set. It is sampled, and about each sample a *view* is taken: a ball of
tip positions and a cone of directions, all combinations of which see the place. The largest such ball follows from the
distances of the line of sight from the obstacles. Planners get a view as a goal with tolerances.
"""

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from ccm_opt.core.arrays import BoolArray, FloatArray, IntArray, in_space
from ccm_opt.core.deadline import Deadline
from ccm_opt.core.errors import Diagnosis, MotionNotFound, NoPlanFound, TimeLimitReached, UnreachableGoal
from ccm_opt.core.length_words import file_length, short_length
from ccm_opt.core.progress import Stages
from ccm_opt.driver.legs import Planner
from ccm_opt.driver.sight_lines import (
    END,
    ERRORS,
    PIECES,
    ROUNDED,
    clear_tips,
    crossed,
    hidden_by_arm,
    hiding_surfaces,
    line_pieces,
    room_at_end,
    sight_room,
)
from ccm_opt.planning.tool_problem import problem_with_tool_links
from ccm_opt.problem import JointPose, LookAt, Problem, TipGoal, Tolerances
from ccm_opt.problem.solution import JointPath
from ccm_opt.robot.arm import Arm
from ccm_opt.scene.bodies import rotation_to_axis
from ccm_opt.scene.distances.enclosures import enclosed
from ccm_opt.scene.distances.surface_tree import SurfaceTree
from ccm_opt.scene.surfaces import TriangleSoup
from ccm_opt.scene.tool_links import points_with_tool
from ccm_opt.scene.workspace import BOUNDARY_NAME, ROOM_NAME

_DIRECTIONS = {2: (180,), 3: (125, 500)}
"""Number of sampled lines of sight, in the plane and in space; more where the place is seen along none of the first
ones. Heuristic: without a normal, 2° apart in the plane, and in space some 18° and 9°."""
_DISTANCES = (0.5, 0.2, 0.8)
"""Sampled distances, as fractions of the range of distances. Heuristic."""
_INSIDE = 0.98
"""Fraction of the largest angle from the normal within which lines of sight are sampled. Heuristic."""
_OFF_AXIS = 1.0 / 3.0
"""Greatest fraction of half the field of view by which a tip's displacement may turn the line of sight. Heuristic: the
rest is left to the direction."""
_LEAST_ROOM = 2e-4
"""Least radius of the ball of tip positions of a view, as a fraction of the arm's length. Heuristic: goals are met to a
fraction of this."""
_USED = 0.999
"""Fraction of the tolerances of a view that is used. Derived: far above rounding."""
_MOST = 10
"""Maximum number of views that are tried. Heuristic."""
_APART = (0.1, float(np.deg2rad(30.0)))
"""Least difference of views that are tried: distance as a fraction of the arm's length, or angle [rad]. Heuristic."""
_FIRST_TRY = {2: 1.0, 3: 0.25}
"""CPU time limit of planning to each view in the first round, in the plane and in space [s]; four times as much in each
further one. Heuristic."""
_TURNED = {2: 0.0, 3: 1.0}
"""Weight of the turn of the line of sight from that at the start, relative to that of its turn from the base, in the
plane and in space. Heuristic."""
_EASY = 0.85
"""Distance from the base, as a fraction of the arm's length, beyond which a tip is harder to bring there. Heuristic."""


@dataclass(frozen=True, eq=False)
class View:
    """A goal for the tip from all of whose poses, within tolerances, a place is seen.

    Attributes:
        goal: position and direction of the tip.
        tolerances: radius of the ball of positions, and half angle of the cone of directions.
    """

    goal: TipGoal
    tolerances: Tolerances


@dataclass(frozen=True)
class ViewPlanner:
    """Planner that leads goals of looking at a place back to goals for the tip; other goals are left as they are.

    Attributes:
        planner: planner of motions to goals for the tip.
        stages: measures the durations of the stages.
        sampled: views of the places for which motions were planned already; legs and tries of a tour share them.
    """

    planner: Planner
    stages: Stages
    sampled: "list[SampledViews]" = field(default_factory=list)

    def plan(self, problem: Problem) -> JointPath:
        """Return a certified path to the problem's goal.

        Raises:
            NoPlanFound: no path was found; the error holds a diagnosis.
        """
        look_at = problem.goal.look_at
        if look_at is None:
            return self.planner.plan(problem)
        with self.stages("views"):
            left = list(self._views(problem, look_at).chosen(problem.start))
        deadline = Deadline.after(problem.planner.time_limit)
        tried, share = len(left), _FIRST_TRY[problem.dimension]
        failures: list[NoPlanFound] = []
        hidden = 0
        while left and not deadline.passed():
            for view in tuple(left):
                options = replace(problem.planner, time_limit=min(share, max(deadline.left, 0.1)))
                leg = replace(problem, goal=view.goal, tolerances=view.tolerances, planner=options)
                try:
                    path = self.planner.plan(leg)
                except TimeLimitReached as failure:
                    failures.append(failure)
                except NoPlanFound as failure:
                    failures.append(failure)
                    left.remove(view)
                else:
                    if not np.any(hidden_by_arm(problem.arm, path.spline(1.0), look_at.place[None])):
                        return path
                    hidden += 1
                    left.remove(view)
                if deadline.passed():
                    break
            share *= 4.0
        raise _not_reached(failures, tried, hidden, passed=deadline.passed())

    def _views(self, problem: Problem, look_at: LookAt) -> "SampledViews":
        """Return the sampled views of a place.

        Raises:
            UnreachableGoal: the place is not seen from any of them.
        """
        views = next((views for views in self.sampled if views.are_of(problem, look_at)), None)
        if views is None:
            views = SampledViews.of(problem, look_at)
            self.sampled.append(views)
        views.refuse()
        return views


def _not_reached(failures: list[NoPlanFound], tried: int, hidden: int, *, passed: bool) -> NoPlanFound:
    """Return the error for a place that is seen from views, none of which was reached."""
    if not failures:
        reason = f"the arm itself hides the place that it looks at, in each of {hidden} views that it reached"
        return MotionNotFound(Diagnosis(reason, "views", ("widen goal.distance or goal.field_of_view_deg",)))
    found = failures[0].diagnosis
    beside = f" ({hidden} were reached, but there the arm itself hides it)" if hidden else ""
    words = f"of {tried} views of the place none was reached{beside}; the most promising one: {found.reason}"
    kind = TimeLimitReached if passed else MotionNotFound
    # What is proved of one view is not proved of others, or of poses between the sampled ones.
    findings = tuple(replace(finding, proved=False) for finding in found.findings)
    return kind(replace(found, reason=words, findings=findings))


@dataclass(frozen=True, eq=False)
class SampledViews:
    """Sampled tip positions from which a place might be seen.

    Attributes:
        posed: problem as given; its start and goal do not matter.
        problem: the same problem, whose arm has its tool as links.
        look_at: the place, and how the arm has to look at it.
        tree: distances from the surfaces that may hide the place.
        tips: tip positions, shape (m, d) [m].
        beyond: distance by which each is too far from the base [m]; at most 0 if it is within reach, shape (m,).
        clear: mask of the positions within reach where the tip keeps clear of the obstacles, shape (m,).
        room: radius of the ball of positions about each from which the place is seen, shape (m,) [m]; not positive if
            it is hidden, and for positions that are not clear.
        limiting: index of the piece of each line of sight with the least room, the number of pieces if the whole line
            crosses an obstacle, or -1 less the index of the obstacle that limits it next to the place, shape (m,).
    """

    posed: Problem
    problem: Problem
    look_at: LookAt
    tree: SurfaceTree
    tips: FloatArray
    beyond: FloatArray
    clear: BoolArray
    room: FloatArray
    limiting: IntArray

    @classmethod
    def of(cls, problem: Problem, look_at: LookAt) -> "SampledViews":
        """Sample tip positions about a place, and measure the room about each line of sight.

        Args:
            problem: problem with the arm, its start and the obstacles.
            look_at: the place, and how the arm has to look at it.
        """
        posed, problem = problem, problem_with_tool_links(problem)
        hiding = hiding_surfaces(problem.workspace, look_at.place)
        for count in _DIRECTIONS[problem.dimension]:
            views = cls._among(posed, problem, look_at, hiding, count)
            if np.any(views.seeing):
                break
        return views

    @classmethod
    def _among(
        cls, posed: Problem, problem: Problem, look_at: LookAt, hiding: TriangleSoup, count: int
    ) -> "SampledViews":
        """Return the views along a number of lines of sight, past surfaces that may hide the place."""
        workspace = problem.workspace
        every = workspace.surface_tree
        tree = every if hiding is workspace.triangle_soup else SurfaceTree.from_triangles(hiding)
        tips, off = sampled_tips(look_at, count)
        away = np.linalg.norm(tips - look_at.place, axis=1)
        beyond = beyond_reach(problem.arm, tips)
        clear = beyond <= 0.0
        clear[clear] = clear_tips(problem, every, tips[clear])
        least, most = look_at.distance
        turn = np.sin(_OFF_AXIS * 0.5 * look_at.field_of_view)
        room = np.minimum.reduce((away - least, most - away, away * turn, away * np.sin(look_at.angle - off)))
        lit, limiting = np.full(len(tips), -np.inf), np.full(len(tips), PIECES)
        free = np.flatnonzero(clear)[~crossed(tree, look_at.place, tips[clear])]
        lit[free], limiting[free] = sight_room(tree, look_at.place, tips[free], float(np.max(room)))
        at_end, owner = room_at_end(hiding, workspace.surface_errors, look_at.place, tips[free], float(np.max(room)))
        limiting[free] = np.where(at_end < lit[free], -1 - owner, limiting[free])
        lit[free] = np.minimum(lit[free], at_end)
        return cls(posed, problem, look_at, tree, tips, beyond, clear, np.minimum(room, lit), limiting)

    def are_of(self, problem: Problem, look_at: LookAt) -> bool:
        """Return whether these are the views of a place for a problem; start and goals of problems do not matter."""
        same = self.posed.arm is problem.arm and self.posed.workspace is problem.workspace
        return same and self.look_at is look_at

    @property
    def seeing(self) -> BoolArray:
        """Mask of the positions from which the place is seen, with room enough for a goal, shape (m,)."""
        return np.asarray(self.room >= _LEAST_ROOM * self.problem.arm.length)

    def refuse(self) -> None:
        """Raise an error if there is no position from which the place is seen.

        Raises:
            UnreachableGoal: there is none; the message says what prevents it, with numbers.
        """
        if np.any(self.seeing):
            return
        self._refuse_inside()
        least, most = self.look_at.distance
        where = f"from {file_length(least)} to {file_length(most)} away"
        near = self.beyond <= 0.0
        count = len(self.tips)
        advice: tuple[str, ...]
        if not np.any(near):
            lacking = short_length(float(np.min(self.beyond)))
            reason = f"no place {where} from what the arm looks at is within reach: the nearest is {lacking} too far"
            advice = (f"lengthen the arm by {lacking} at least", "widen goal.distance")
        elif not np.any(self.clear):
            reason = (
                f"of {count} places {where} from what the arm looks at {int(np.sum(near))} are within reach, but the "
                "tip is too near to an obstacle at each of them"
            )
            advice = ("widen goal.distance or goal.angle_deg", "lower workspace.clearance")
        else:
            names = self._hiding()
            listed = " or ".join(f"'{name}' ({times})" for name, times in names.most_common(3))
            reason = (
                f"hidden by {listed} from everywhere within reach: of {count} places {where} the tip can be at "
                f"{int(np.sum(self.clear))} as far as its length and the obstacles go, and none of them sees the place"
            )
            advice = (
                f"move '{names.most_common(1)[0][0]}', or goal.look_at out of it",
                "widen goal.distance or goal.angle_deg",
            )
        if np.any(near) and self.look_at.normal is not None:
            other = SampledViews.of(self.problem, replace(self.look_at, normal=-self.look_at.normal))
            if np.any(other.seeing):
                advice = ("reverse goal.normal: from its other side the place is seen", *advice)
        raise UnreachableGoal(Diagnosis(f"goal.look_at: {reason}", "views", advice))

    def _refuse_inside(self) -> None:
        """Raise an error if the place itself is deeper inside an obstacle than a place on its surface may be.

        Raises:
            UnreachableGoal: it is; the message says how deep.
        """
        place = self.look_at.place
        if not len(enclosed(self.problem.workspace, place[None], self.problem.arm.tip_radius)):
            return
        far = 2.0 * float(np.linalg.norm(np.ptp(self.tips, axis=0))) + self.problem.arm.length
        near = self.problem.workspace.surface_tree.nearest(np.repeat(in_space(place)[None, None], 2, axis=1), far)
        owner = int(near.owner[0])
        error = ERRORS * float(self.problem.workspace.surface_errors[owner])
        if near.gap[0] <= max(ROUNDED * self.look_at.distance[0], error):
            return
        name = self.problem.workspace.triangle_soup.names[owner]
        depth = short_length(float(near.gap[0]))
        where = f"outside the {name}" if name in (ROOM_NAME, BOUNDARY_NAME) else f"inside '{name}'"
        reason = f"goal.look_at: the place is {depth} {where} and is seen from nowhere"
        advice = (
            "move goal.look_at into the room" if where.startswith("outside") else "move goal.look_at to the surface"
        )
        raise UnreachableGoal(Diagnosis(reason, "views", (advice,)))

    def _hiding(self) -> Counter[str]:
        """Return how many of the lines of sight from clear positions each obstacle hides, by its name."""
        hidden = np.flatnonzero(self.clear)
        place, tips = self.look_at.place, self.tips[hidden][:, None]
        start, end, _ = line_pieces(place, self.tips[hidden])
        start, end = np.append(start, place + END * (tips - place), axis=1), np.append(end, tips, axis=1)
        at = np.arange(len(hidden)), np.maximum(self.limiting[hidden], 0)
        pieces = np.stack((in_space(start[at]), in_space(end[at])), axis=1)
        owners = self.tree.nearest(pieces, float(self.look_at.distance[1])).owner
        names = self.problem.workspace.triangle_soup.names
        limiting = self.limiting[hidden]
        owners = np.where(limiting < 0, -1 - limiting, owners)
        return Counter(names[owner] if owner >= 0 else "the sight's own limits" for owner in owners)

    def chosen(self, start: JointPose) -> Iterator[View]:
        """Yield up to ten views that differ, the most promising first.

        Args:
            start: pose from which the arm moves to them.
        """
        place = self.look_at.place
        seeing = np.flatnonzero(self.seeing)
        left = seeing[np.argsort(self._costs(seeing, start), kind="stable")]
        for _ in range(_MOST):
            if len(left) == 0:
                return
            k = left[0]
            towards = place - self.tips[k]
            radius = float(self.room[k])
            turn = 0.5 * self.look_at.field_of_view - float(np.arcsin(radius / np.linalg.norm(towards)))
            tolerances = Tolerances(_USED * min(radius, self.problem.arm.length), _USED * turn)
            yield View(TipGoal(self.tips[k], towards / np.linalg.norm(towards)), tolerances)
            left = left[~self._alike(left, k)]

    def _alike(self, some: IntArray, one: np.intp) -> BoolArray:
        """Return a mask of the positions that need not be tried beside one."""
        lines = self.tips - self.look_at.place
        near = np.linalg.norm(self.tips[some] - self.tips[one], axis=1) < _APART[0] * self.problem.arm.length
        return np.asarray(near & (_angles(lines[some], lines[one]) < _APART[1]))

    def _costs(self, some: IntArray, start: JointPose) -> FloatArray:
        """Return how unpromising some positions are.

        They are if the line of sight turns back to the base or away from that at the start, if they are far from the
        base, or have little room.

        Args:
            some: indices of the positions.
            start: pose from which the arm moves to them.
        """
        arm, tips = self.problem.arm, self.tips[some]
        out = tips - _bases(arm, tips)
        ahead = self.look_at.place - tips
        stretched = np.maximum(np.linalg.norm(out, axis=1) / arm.length - _EASY, 0.0) / (1.0 - _EASY)
        narrow = 1.0 - np.clip(self.room[some] / np.max(self.room), 0.0, 1.0)
        before = np.diff(points_with_tool(self.posed.arm, start.configuration(self.posed.arm))[-2:], axis=0)[0]
        turned = _TURNED[arm.dimension] * _angles(ahead, before)
        return np.asarray((_angles(out, ahead) + turned) / np.pi + stretched + narrow)


def _angles(some: FloatArray, other: FloatArray) -> FloatArray:
    """Return the angles between vectors (..., d) and others, of shapes that go together [rad]."""
    lengths = np.linalg.norm(some, axis=-1) * np.linalg.norm(other, axis=-1)
    return np.asarray(np.arccos(np.clip(np.sum(some * other, axis=-1) / np.maximum(lengths, 1e-300), -1.0, 1.0)))


def sampled_tips(look_at: LookAt, count: int) -> tuple[FloatArray, FloatArray]:
    """Return sampled tip positions, shape (m, d) [m], and the angles of their lines of sight from the normal, (m,)."""
    d = len(look_at.place)
    widest = np.pi if look_at.normal is None else _INSIDE * look_at.angle
    axis = np.eye(d)[-1] if look_at.normal is None else look_at.normal
    if d == 2:
        off = np.linspace(-widest, widest, count, endpoint=look_at.normal is not None)
        across = np.array([-axis[1], axis[0]])
        lines = np.cos(off)[:, None] * axis + np.sin(off)[:, None] * across
    else:
        # On a golden-ratio spiral over the cap of the sphere.
        height = 1.0 - (1.0 - np.cos(widest)) * (np.arange(count) + 0.5) / count
        turn = np.pi * (1.0 + np.sqrt(5.0)) * np.arange(count)
        first, second = rotation_to_axis(axis).T[1:]
        aside = np.sqrt(np.maximum(1.0 - height**2, 0.0))
        around = np.cos(turn)[:, None] * first + np.sin(turn)[:, None] * second
        off = np.arccos(height)
        lines = height[:, None] * axis + aside[:, None] * around
    low, high = look_at.distance
    away = low + np.array(_DISTANCES) * (high - low)
    off = np.zeros(count) if look_at.normal is None else np.abs(off)
    return (look_at.place + away[:, None, None] * lines).reshape(-1, d), np.tile(off, len(away))


def _bases(arm: Arm, tips: FloatArray) -> FloatArray:
    """Return the positions of the base on its feed axis that are nearest to tip positions (m, d), shape (m, d) [m]."""
    low, high = arm.base_range
    along = np.clip((tips - arm.base) @ arm.direction, low, high)
    return np.asarray(arm.base + along[:, None] * arm.direction)


def beyond_reach(arm: Arm, tips: FloatArray) -> FloatArray:
    """Return by how much tip positions (m, d) are farther from the base than the arm is long, shape (m,) [m].

    Axes other than a feed axis may carry the base anywhere.
    """
    if arm.carrier:
        return np.zeros(len(tips))
    return np.asarray(np.linalg.norm(tips - _bases(arm, tips), axis=1) - arm.length)
