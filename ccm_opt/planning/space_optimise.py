"""Optimises a found motion in space.

A step that the certificate refuses is shortened, then damped, and what an interval lacks becomes dearer; so the motion
stays in its homotopy class, and the last iterate is always fit for use.
"""

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.planning.goal import moved_onto
from ccm_opt.planning.limits.limit import UNBOUNDED, KeyframeRows, MotionCost, restored_keyframes
from ccm_opt.planning.limits.user_motion_rows import UserCosts
from ccm_opt.planning.motion import SpaceMotion
from ccm_opt.planning.optimisation.interval_rows import IntervalRows
from ccm_opt.planning.optimisation.objective import Objective, decimated, normalised, subdivided
from ccm_opt.planning.optimisation.sequential_convex import MotionProgram, sequential_convex
from ccm_opt.planning.passed_places import passings
from ccm_opt.planning.settings import ConvexSettings
from ccm_opt.planning.space_rows import motion_rows, room_lacking, room_lacking_on_the_way
from ccm_opt.planning.space_sweep import SpaceSweep, failing_edges, in_pieces
from ccm_opt.planning.space_task import SpaceTask
from ccm_opt.planning.step import SpaceStepper
from ccm_opt.robot.arm import Arm

_LEG_DEPTH = 4
"""How often an edge of the thinned motion may be halved by its certificate."""
_FIRST_STRIDE = 8
"""Keyframes that an edge skips at first."""
_ROUNDS = 24
"""Most steps."""
_FIRST_ROUNDS = 2
"""Steps at many keyframes, before the motion is thinned again."""
_SPARE_TURN = 0.004
"""Of the limits that rows leave [rad, m]."""
_NEAR_LIMIT = 0.3
"""Coordinates nearer to their limit than this are limited in the program [rad, m]."""
_KNOT_BEND = 1.1
"""Bound on the bend by the curvature at a knot of a fed arm, as a multiple of the joint limit; a joint takes the mean
about its place, which is less."""
_PASSING = 0.5
"""How near the tip stays to the places that it passes, as a share of what counts as passing."""

_FINER_LACK = 0.15
"""A motion that lacks more than this share of the wanted gap is made again of more keyframes; in pipes and wing boxes
with few links seven in ten of those come out with all the room that there is."""
_FINER_INTERVALS = 32
"""Least number of intervals then."""
_FINER_PRICE = 400.0
"""First price of slack then."""
_MANY = 1.2
"""Intervals that are many, as a multiple of those wanted."""
_MARGIN = 0.02
"""Gap that rows ask for beyond contact [u]."""
_SEEN = 0.3
"""Rows nearer to their bound than this enter the program [u]."""
_GROUPS = 24
"""Arms with more links than this have rows for groups of neighbouring joints."""


@dataclass(frozen=True, eq=False)
class PassingKeyframes:
    """Keyframes at which the tip passes places.

    Attributes:
        keyframe: of each place, shape (m,).
        places: shape (m, 3) [m].
        reach: how far off the tip may be at that keyframe, shape (m,) [m].
    """

    keyframe: IntArray
    places: FloatArray
    reach: FloatArray

    @classmethod
    def of(cls, sweep: SpaceSweep, keyframe: IntArray, places: FloatArray, wanted: float) -> "PassingKeyframes":
        """Keyframes that stay as near as is wanted [m], or as near as they are."""
        away = np.linalg.norm(sweep.joints[keyframe, -1] - places, axis=1)
        return cls(keyframe, places, np.maximum(wanted, away))

    def rows(self, sweep: SpaceSweep) -> KeyframeRows:
        """Six rows a place: the tip stays in the cube that fits into the ball, or leaves it no farther on any axis."""
        moved = np.flatnonzero(self.keyframe > 0)
        keyframe = self.keyframe[moved]
        unit = sweep.stepper.unit
        off = (sweep.joints[keyframe, -1] - self.places[moved]) / unit
        most = np.maximum(self.reach[moved, None] / (np.sqrt(3.0) * unit), np.abs(off))
        slopes = sweep.moving[keyframe, sweep.curve.arm.links] / unit
        p = slopes.shape[-1]
        return KeyframeRows(
            np.repeat(keyframe, 6),
            np.concatenate((slopes, -slopes), axis=1).reshape(-1, p),
            np.concatenate((-most - off, off - most), axis=1).ravel(),
            np.full(6 * len(keyframe), UNBOUNDED),
        )

    def holds(self, sweep: SpaceSweep) -> bool:
        """Whether the tip is within reach of every place at its keyframe."""
        away = np.linalg.norm(sweep.joints[self.keyframe, -1] - self.places, axis=1)
        return bool(np.all(away <= self.reach * (1.0 + 1e-9)))


@dataclass(frozen=True, eq=False)
class SpaceProgram(MotionProgram[SpaceSweep]):
    """A motion in space.

    Attributes:
        task: what the motion is for.
        stepper: of its unknowns.
        u: path parameters of the keyframes, shape (K + 1,).
        passing: keyframes at which the tip passes places; None where it need not.
    """

    task: SpaceTask
    stepper: SpaceStepper
    u: FloatArray
    passing: PassingKeyframes | None = None

    @classmethod
    def of(
        cls,
        task: SpaceTask,
        stepper: SpaceStepper,
        u: FloatArray,
        passing: PassingKeyframes | None,
        *,
        end_fixed: bool,
    ) -> "SpaceProgram":
        """The program of a task; arguments are attributes."""
        weights = normalised(task.weights)
        return cls(end_fixed, task.deadline, weights, task.wanted_gap, task, stepper, u, passing)

    @property
    def steps(self) -> ConvexSettings:
        """Numbers of the steps."""
        return self.task.settings.optimisation.steps

    @property
    def groups(self) -> int:
        """Arms with more links than this have rows for groups of neighbouring joints."""
        return _GROUPS

    @property
    def arm(self) -> Arm:
        """The arm."""
        return self.task.arm

    def sweep(self, unknowns: FloatArray) -> SpaceSweep:
        """The motion through keyframes, shape (K + 1, p)."""
        return SpaceSweep(self.stepper, unknowns)

    def objective(self, intervals: int) -> Objective:
        """The quadratic part of what is made small: a coordinate counts by the speed that it allows."""
        task = self.task
        return Objective(self.stepper.curve, intervals, self.weights, None, task.slowness)

    def rows(self, sweep: SpaceSweep) -> IntervalRows:
        """All rows over intervals about a motion."""
        return motion_rows(sweep, self.wanted_gap, _MARGIN * self.unit, _SEEN * self.unit)

    def seen_by_steps(self, sweep: SpaceSweep) -> float:
        """How near to their bound rows enter the QP [m]."""
        del sweep
        return _SEEN * self.unit

    def keyframe_rows(self, sweep: SpaceSweep) -> tuple[KeyframeRows, ...]:
        """Limits of coordinates, gaps of the user, and places that the tip passes."""
        found = [_limit_rows(sweep)]
        if sweep.curve.arm.base_axes:
            found.append(_knot_rows(sweep))
        if self.task.user is not None:
            found.extend(self.task.user.keyframe_rows(sweep, self.u))
        if self.passing is not None:
            found.append(self.passing.rows(sweep))
        return tuple(found)

    def equations(self, sweep: SpaceSweep) -> tuple[KeyframeRows, ...]:
        """Equations of the user."""
        return () if self.task.user is None else self.task.user.keyframe_equations(sweep, self.u)

    def tip_rows(self, sweep: SpaceSweep) -> FloatArray:
        """Rows that hold the tip in its goal, shape (r, p)."""
        if self.task.goal is None:
            raise ValueError("a motion without a goal for the tip has a fixed end")
        return self.task.goal.rows(sweep.poses[-1], self.unit)

    def further_costs(self, sweep: SpaceSweep) -> tuple[MotionCost, ...]:
        """The user's costs."""
        del sweep
        return () if self.task.user is None else (UserCosts(self.task.user.terms, self.u),)

    def lack(self, sweep: SpaceSweep) -> float:
        """Room that a motion lacks over all its intervals, in nominal links."""
        return float(np.sum(room_lacking(sweep, self.wanted_gap))) / self.unit

    def ended(self, unknowns: FloatArray) -> FloatArray | None:
        """The keyframes on the user's equations, the last one exactly on the goal; None where that fails."""
        goal = self.task.limited_goal
        if not self.end_fixed and goal is not None:
            last = self.stepper.pose(unknowns[-1])
            onto = moved_onto(self.stepper.space, goal, last)
            if goal.on_goal(onto) and goal.limits_met(onto):
                unknowns = np.vstack((unknowns[:-1], onto.v))
            elif not goal.met(last):
                return None
        return restored_keyframes(self.task.user_limits, self.stepper.curve, unknowns, self.u)

    def feasible(self, sweep: SpaceSweep, before: SpaceSweep) -> bool:
        """Whether a motion's keyframes keep what they have to."""
        user = self.task.user
        held = user is None or user.holds(sweep, before, self.u)
        held = held and (self.passing is None or self.passing.holds(sweep))
        return held and all(self.stepper.within_limits(q) for q in sweep.configurations)

    def failures(self, sweep: SpaceSweep) -> IntArray:
        """Intervals of a motion that are not certified."""
        return failing_edges(self.stepper, sweep.unknowns)


def _limit_rows(sweep: SpaceSweep) -> KeyframeRows:
    """The limits of coordinates that are near them and can be moved."""
    arm = sweep.curve.arm
    up = arm.upper_limits - sweep.configurations[1:]
    down = sweep.configurations[1:] - arm.lower_limits
    at, coordinate = np.nonzero((np.minimum(up, down) < _NEAR_LIMIT) & (arm.upper_limits > arm.lower_limits))
    high = np.maximum(up[at, coordinate] - _SPARE_TURN, 0.0)
    low = np.maximum(down[at, coordinate] - _SPARE_TURN, 0.0)
    return KeyframeRows(at + 1, sweep.slopes[at + 1, coordinate], -low, high)


def _knot_rows(sweep: SpaceSweep) -> KeyframeRows:
    """Bounds on the curvature at the knots of a fed arm.

    Between two keyframes the feed carries joints past knots at which no joint is at either of them.
    """
    arm = sweep.curve.arm
    rows = arm.link_length * sweep.curve.curvature_rows
    now = sweep.unknowns[1:] @ rows.T
    most = np.maximum(_KNOT_BEND * arm.joint_limit, np.abs(now))
    keyframe = np.repeat(np.arange(1, sweep.intervals + 1), len(rows))
    return KeyframeRows(keyframe, np.tile(rows, (sweep.intervals, 1)), (-most - now).ravel(), (most - now).ravel())


def optimise(motion: SpaceMotion, task: SpaceTask) -> SpaceMotion:
    """A shorter, smoother and roomier motion in the same homotopy class; the given one where none is found.

    Where that lacks room, another is made of more keyframes, in which room is dearer, and the roomier one is taken.

    Args:
        motion: certified.
        task: what it is for.
    """
    if task.optimiser == "none":
        return motion
    settings = task.settings.optimisation
    first = _optimised(motion, task)
    lacking = _lacking(task, first)
    if lacking <= _FINER_LACK * task.wanted_gap or task.deadline.passed():
        return first
    steps = settings.steps
    dearer = replace(steps, price=_FINER_PRICE, highest_price=steps.highest_price * _FINER_PRICE / steps.price)
    finer = replace(settings, intervals=_FINER_INTERVALS, steps=dearer)
    second = _optimised(motion, replace(task, settings=replace(task.settings, optimisation=finer)))
    return second if _lacking(task, second) < lacking else first


def _lacking(task: SpaceTask, motion: SpaceMotion) -> float:
    """By how much more of the wanted room a motion lacks on its way than at its ends [m]."""
    sweep = SpaceSweep(task.stepper(motion.curve, 0.0), motion.unknowns)
    return room_lacking_on_the_way(sweep, task.wanted_gap)


def _optimised(motion: SpaceMotion, task: SpaceTask) -> SpaceMotion:
    """What comes of one run of the optimisation; the motion itself where nothing does."""
    settings = task.settings.optimisation
    # The straight way between two keyframes is the best there is, unless the user wants something else of it.
    if task.deadline.passed() or (len(motion.unknowns) < 3 and task.user is None and not task.via):
        return motion
    stepper = task.stepper(motion.curve, 0.0)
    end_fixed = _is_end_fixed(task, stepper, motion.unknowns[-1])
    left = _ROUNDS
    unknowns = motion.unknowns
    u = motion.path_parameters
    while left > 0 and not task.deadline.passed():
        passed = _with_passings(task, stepper, unknowns, u)
        few = _few_keyframes(task, stepper, motion, *passed)
        if few is None and left == _ROUNDS:
            return motion
        if few is not None:
            keyframes, u = few
        else:
            # No fewer keep the user's constraints: those of the round before do, and are optimised to the end.
            keyframes = unknowns
        many = few is not None and len(keyframes) - 1 > _MANY * settings.intervals
        taken = min(left, _FIRST_ROUNDS) if many else left
        passing = None if not task.via else _passing(task, stepper, keyframes, passed[0][passed[2]])
        better = sequential_convex(SpaceProgram.of(task, stepper, u, passing, end_fixed=end_fixed), keyframes, taken)
        left -= taken
        stuck = np.array_equal(better, keyframes)
        unknowns = better
        if not many or stuck:
            break
    if len(failing_edges(stepper, unknowns)) > 0:
        # Keyframes in between belong to pieces that are not those which were certified.
        return motion
    return SpaceMotion(
        motion.curve,
        unknowns,
        motion.curve.configurations(in_pieces(stepper, unknowns)),
        motion.candidate,
        None if motion.u is None else u,
    )


def _few_keyframes(
    task: SpaceTask, stepper: SpaceStepper, motion: SpaceMotion, unknowns: FloatArray, u: FloatArray, kept: IntArray
) -> tuple[FloatArray, FloatArray] | None:
    """The keyframes of ``thinned``, put onto the user's constraints; None where that cannot be done."""
    keyframes, places = thinned(task, motion, unknowns, u, kept)
    if task.user is None:
        return keyframes, places
    keyframes = restored_keyframes(task.user_limits, stepper.curve, keyframes, places)
    sweep = SpaceSweep(stepper, keyframes)
    if not task.user.holds(sweep, sweep, places) or len(failing_edges(stepper, keyframes)) > 0:
        return None
    return keyframes, places


def _is_end_fixed(task: SpaceTask, stepper: SpaceStepper, end: FloatArray) -> bool:
    """Whether a motion has to end in a given pose: where no tip counts, or limits keep it a little off its goal."""
    goal = task.limited_goal
    if goal is None:
        return True
    exact = moved_onto(stepper.space, goal, stepper.pose(end))
    return not (goal.on_goal(exact) and goal.limits_met(exact) and stepper.within_limits(exact.q))


def _with_passings(
    task: SpaceTask, stepper: SpaceStepper, unknowns: FloatArray, u: FloatArray
) -> tuple[FloatArray, FloatArray, IntArray]:
    """A motion with keyframes where the tip comes nearest to the places that it passes, and their numbers.

    Args:
        task: with the places.
        stepper: makes poses.
        unknowns: at the keyframes, shape (k, p).
        u: their path parameters, shape (k,).

    Returns:
        The same with more keyframes, and the numbers of those at which the places are passed, shape (m,).
    """
    if not task.via:
        return unknowns, u, np.zeros(0, dtype=np.intp)
    tips = np.stack([stepper.pose(v).tip for v in unknowns])
    found = passings(tips, np.stack(task.via))
    along = np.unique(np.append(np.arange(len(u), dtype=np.float64), found.along))
    whole = np.column_stack([np.interp(along, np.arange(len(u)), column) for column in (*unknowns.T, u)])
    return whole[:, :-1], whole[:, -1], np.searchsorted(along, found.along)


def _passing(task: SpaceTask, stepper: SpaceStepper, keyframes: FloatArray, passed: FloatArray) -> PassingKeyframes:
    """Which keyframes, shape (K + 1, p), pass the places of a task: those with given unknowns, shape (m, p)."""
    away = np.max(np.abs(keyframes[None] - passed[:, None]), axis=2)
    wanted = _PASSING * task.via_reach
    return PassingKeyframes.of(SpaceSweep(stepper, keyframes), np.argmin(away, axis=1), np.stack(task.via), wanted)


def thinned(
    task: SpaceTask, motion: SpaceMotion, unknowns: FloatArray, u: FloatArray, kept: IntArray
) -> tuple[FloatArray, FloatArray]:
    """Few keyframes of a motion, every edge between them certified, and their path parameters.

    Args:
        task: what the motion is for.
        motion: whose keyframes they are.
        unknowns: of all keyframes, shape (k, p).
        u: path parameters of the same, shape (k,).
        kept: numbers of keyframes that stay, shape (m,).

    Returns:
        Of shapes (K + 1, p) and (K + 1,); where the motion does not know its path parameters they are even.
    """
    settings = task.settings.optimisation
    stepper = task.stepper(motion.curve, 0.0)
    p = unknowns.shape[1]
    labelled = np.column_stack((unknowns, u))

    def failing(some: FloatArray) -> IntArray:
        return failing_edges(stepper, some[:, :p], _LEG_DEPTH)

    def fewer(stride: int) -> FloatArray:
        ends = np.unique((0, *kept, len(labelled) - 1))
        parts = [decimated(labelled[a : b + 1], failing, stride) for a, b in pairwise(ends)]
        return np.vstack((labelled[:1], *(part[1:] for part in parts)))

    few = fewer(_FIRST_STRIDE)
    configurations = motion.curve.configurations(few[:, :p])
    sizes = np.linalg.norm(np.diff(configurations * task.slowness, axis=0), axis=1)
    whole = subdivided(few, sizes, settings.intervals)
    if len(failing_edges(stepper, whole[:, :p])) > 0:
        # The bends of a fed arm are not linear along an edge: what lies in between is beyond a limit, and the motion's
        # own keyframes are not.
        whole = fewer(max(1, len(unknowns) // settings.intervals))
    own = np.linspace(0.0, 1.0, len(whole)) if motion.u is None else whole[:, p]
    return np.ascontiguousarray(whole[:, :p]), own
