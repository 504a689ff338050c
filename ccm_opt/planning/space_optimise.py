"""Optimises a found motion in space.

A step that the certificate refuses is shortened, then damped, and what an interval lacks becomes dearer; so the motion
stays in its homotopy class, and the last iterate is always fit for use.
"""

from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise

import numpy as np

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.planning.curve_map import CurveMap
from ccm_opt.planning.goal import moved_onto
from ccm_opt.planning.limits.limit import UNBOUNDED, KeyframeRows, LimitOf, restored_keyframes
from ccm_opt.planning.limits.limit_stack import within_limits
from ccm_opt.planning.motion import SpaceMotion
from ccm_opt.planning.optimisation.objective import decimated, normalised, subdivided
from ccm_opt.planning.optimisation.sequential_convex import MotionProgram, sequential_convex
from ccm_opt.planning.passed_places import passings
from ccm_opt.planning.space_sweep import SpaceSweep, room_lacking, room_lacking_on_the_way
from ccm_opt.planning.space_task import SpaceTask
from ccm_opt.planning.step import SpaceStepper

_LEG_DEPTH = 4
"""How often an edge of the thinned motion may be halved by its certificate."""
_FIRST_STRIDE = 8
"""Keyframes that an edge skips at first."""
_ROUNDS = 24
"""Most steps."""
_FIRST_ROUNDS = 2
"""Steps at many keyframes, before the motion is thinned again."""
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
class PassingKeyframes(LimitOf[CurveMap]):
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

    def keyframe_rows(self, sweep: SpaceSweep, u: FloatArray) -> tuple[KeyframeRows, ...]:
        """Six rows a place: the tip stays in the cube that fits into the ball, or leaves it no farther on any axis."""
        del u
        moved = np.flatnonzero(self.keyframe > 0)
        keyframe = self.keyframe[moved]
        unit = sweep.space.nominal_length
        off = (sweep.joints[keyframe, -1] - self.places[moved]) / unit
        most = np.maximum(self.reach[moved, None] / (np.sqrt(3.0) * unit), np.abs(off))
        slopes = sweep.moving[keyframe, sweep.space.arm.links] / unit
        p = slopes.shape[-1]
        rows = KeyframeRows(
            np.repeat(keyframe, 6),
            np.concatenate((slopes, -slopes), axis=1).reshape(-1, p),
            np.concatenate((-most - off, off - most), axis=1).ravel(),
            np.full(6 * len(keyframe), UNBOUNDED),
        )
        return (rows,)

    def holds(self, sweep: SpaceSweep, before: SpaceSweep, u: FloatArray) -> bool:
        """Whether the tip is within reach of every place at its keyframe."""
        del before, u
        away = np.linalg.norm(sweep.joints[self.keyframe, -1] - self.places, axis=1)
        return bool(np.all(away <= self.reach * (1.0 + 1e-9)))


def space_program(
    task: SpaceTask, stepper: SpaceStepper, u: FloatArray, passing: PassingKeyframes | None, *, end_fixed: bool
) -> MotionProgram[SpaceSweep]:
    """The program of a motion.

    Args:
        task: what it is for.
        stepper: of its unknowns.
        u: path parameters of the keyframes, shape (K + 1,).
        passing: keyframes at which the tip passes places; None where it need not.
        end_fixed: whether the last keyframe stays.
    """
    unit = stepper.space.nominal_length
    return MotionProgram(
        curve=stepper.space,
        sweep=partial(SpaceSweep, stepper.space),
        limits=(
            *task.limits(_MARGIN * unit, task.wanted_gap, _SEEN * unit),
            *(() if passing is None else (passing,)),
        ),
        failures=lambda sweep: stepper.failing_edges(sweep.unknowns),
        goal=task.limited_goal,
        end_fixed=end_fixed,
        u=u,
        deadline=task.deadline,
        weights=normalised(task.weights),
        wanted_gap=task.wanted_gap,
        seen=_SEEN * unit,
        groups=_GROUPS,
        steps=task.settings.optimisation.steps,
        scale=task.slowness,
        lack=lambda sweep: float(np.sum(room_lacking(sweep, task.contact_certificate, task.wanted_gap))) / unit,
    )


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
    sweep = SpaceSweep(motion.curve, motion.unknowns)
    return room_lacking_on_the_way(sweep, task.contact_certificate, task.wanted_gap)


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
        better = sequential_convex(space_program(task, stepper, u, passing, end_fixed=end_fixed), keyframes, taken)
        left -= taken
        stuck = np.array_equal(better, keyframes)
        unknowns = better
        if not many or stuck:
            break
    if len(stepper.failing_edges(unknowns)) > 0:
        # Keyframes in between belong to pieces that are not those which were certified.
        return motion
    return SpaceMotion(
        motion.curve,
        unknowns,
        motion.curve.configurations(motion.curve.in_pieces(unknowns)),
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
    keyframes = restored_keyframes(task.user_limits, stepper.space, keyframes, places)
    sweep = SpaceSweep(stepper.space, keyframes)
    if not task.user.holds(sweep, sweep, places) or len(stepper.failing_edges(keyframes)) > 0:
        return None
    return keyframes, places


def _is_end_fixed(task: SpaceTask, stepper: SpaceStepper, end: FloatArray) -> bool:
    """Whether a motion has to end in a given pose: where no tip counts, or limits keep it a little off its goal."""
    goal = task.limited_goal
    if task.goal_pose is not None:
        return True
    exact = moved_onto(stepper.space, goal, stepper.pose(end))
    return not (goal.on_goal(exact) and goal.limits_met(exact) and within_limits(task.arm, exact.q))


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
    return PassingKeyframes.of(
        SpaceSweep(stepper.space, keyframes), np.argmin(away, axis=1), np.stack(task.via), wanted
    )


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
        return stepper.failing_edges(some[:, :p], _LEG_DEPTH)

    def fewer(stride: int) -> FloatArray:
        ends = np.unique((0, *kept, len(labelled) - 1))
        parts = [decimated(labelled[a : b + 1], failing, stride) for a, b in pairwise(ends)]
        return np.vstack((labelled[:1], *(part[1:] for part in parts)))

    few = fewer(_FIRST_STRIDE)
    configurations = motion.curve.configurations(few[:, :p])
    sizes = np.linalg.norm(np.diff(configurations * task.slowness, axis=0), axis=1)
    whole = subdivided(few, sizes, settings.intervals)
    if len(stepper.failing_edges(whole[:, :p])) > 0:
        # The bends of a fed arm are not linear along an edge: what lies in between is beyond a limit, and the motion's
        # own keyframes are not.
        whole = fewer(max(1, len(unknowns) // settings.intervals))
    own = np.linspace(0.0, 1.0, len(whole)) if motion.u is None else whole[:, p]
    return np.ascontiguousarray(whole[:, :p]), own
