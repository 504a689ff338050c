"""Thins a certified motion to few keyframes, optimises them all at once, and keeps what is certified."""

from dataclasses import replace
from itertools import pairwise

import numpy as np

from ccm_opt.ground.arrays import FloatArray, IntArray
from ccm_opt.motion.optimisation.keyframes import decimated, subdivided
from ccm_opt.space.motion.optimisation.passing_keyframes import PassingKeyframes
from ccm_opt.space.motion.optimisation.rows import room_lacking_on_the_way
from ccm_opt.space.motion.optimisation.space_sequential_convex import SequentialConvex
from ccm_opt.space.motion.optimisation.space_sweep import SpaceSweep
from ccm_opt.space.motion.optimisation.user_keyframes import UserKeyframes
from ccm_opt.space.motion.passed_places import passings
from ccm_opt.space.motion.pieces import failing_edges, in_pieces
from ccm_opt.space.motion.space_goal import onto_goal
from ccm_opt.space.motion.space_step import SpaceStepper
from ccm_opt.space.motion.task import SpaceMotion, SpaceTask


def optimise(motion: SpaceMotion, task: SpaceTask) -> SpaceMotion:
    """A shorter, smoother and roomier motion in the same homotopy class; the given one where none is found.

    Where that lacks room, another is made of more keyframes, in which room is dearer, and the roomier one is taken.

    Args:
        motion: certified.
        task: what it is for.
    """
    settings = task.settings.optimisation
    first = _optimised(motion, task)
    lacking = _lacking(task, first)
    if lacking <= settings.finer_lack * task.wanted_gap or task.deadline.passed():
        return first
    finer = replace(settings, intervals=settings.finer_intervals, price=settings.finer_price)
    finer = replace(finer, highest_price=settings.highest_price * settings.finer_price / settings.price)
    second = _optimised(motion, replace(task, settings=replace(task.settings, optimisation=finer)))
    return second if _lacking(task, second) < lacking else first


def _lacking(task: SpaceTask, motion: SpaceMotion) -> float:
    """By how much more of the wanted room a motion lacks on its way than at its ends [m]."""
    sweep = SpaceSweep(task.stepper(motion.curve, 0.0), motion.unknowns)
    return room_lacking_on_the_way(sweep, task.wanted_gap, task.settings.optimisation)


def _optimised(motion: SpaceMotion, task: SpaceTask) -> SpaceMotion:
    """What comes of one run of the optimisation; the motion itself where nothing does."""
    settings = task.settings.optimisation
    # The straight way between two keyframes is the best there is, unless the user wants something else of it.
    if task.deadline.passed() or (len(motion.unknowns) < 3 and task.user is None and not task.via):
        return motion
    stepper = task.stepper(motion.curve, 0.0)
    end_fixed = _is_end_fixed(task, stepper, motion.unknowns[-1])
    left = settings.rounds
    unknowns = motion.unknowns
    u = _parameters(motion)
    while left > 0 and not task.deadline.passed():
        passed = _with_passings(task, stepper, unknowns, u)
        few = _few_keyframes(task, stepper, motion, *passed)
        if few is None and left == settings.rounds:
            return motion
        if few is not None:
            keyframes, u = few
        else:
            # No fewer keep the user's constraints: those of the round before do, and are optimised to the end.
            keyframes = unknowns
        many = few is not None and len(keyframes) - 1 > settings.many * settings.intervals
        taken = min(left, settings.first_rounds) if many else left
        terms = None if task.user is None else UserKeyframes(task.user, u)
        passing = None if not task.via else _passing(task, stepper, keyframes, passed[0][passed[2]])
        better = SequentialConvex(task, stepper, end_fixed, terms, passing).optimised(keyframes, taken)
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
    terms = UserKeyframes(task.user, places)
    keyframes = terms.restored(stepper, keyframes)
    if not terms.holds(SpaceSweep(stepper, keyframes)) or len(failing_edges(stepper, keyframes)) > 0:
        return None
    return keyframes, places


def _is_end_fixed(task: SpaceTask, stepper: SpaceStepper, end: FloatArray) -> bool:
    """Whether a motion has to end in a given pose: where no tip counts, or limits keep it a little off its goal."""
    if task.goal is None:
        return True
    exact = onto_goal(stepper, task.goal, stepper.pose(end))
    return exact is None or not stepper.within_limits(exact.q)


def _parameters(motion: SpaceMotion) -> FloatArray:
    """Path parameters of the keyframes of a motion, even ones where it does not know its own, shape (K,)."""
    return np.linspace(0.0, 1.0, len(motion.unknowns)) if motion.u is None else motion.u


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
    wanted = task.settings.optimisation.passing * task.via_reach
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
        return failing_edges(stepper, some[:, :p], settings.leg_depth)

    def fewer(stride: int) -> FloatArray:
        ends = np.unique((0, *kept, len(labelled) - 1))
        parts = [decimated(labelled[a : b + 1], failing, stride) for a, b in pairwise(ends)]
        return np.vstack((labelled[:1], *(part[1:] for part in parts)))

    few = fewer(settings.first_stride)
    configurations = motion.curve.configurations(few[:, :p])
    sizes = np.linalg.norm(np.diff(configurations * task.slowness, axis=0), axis=1)
    whole = subdivided(few, sizes, settings.intervals)
    if len(failing_edges(stepper, whole[:, :p])) > 0:
        # The bends of a fed arm are not linear along an edge: what lies in between is beyond a limit, and the motion's
        # own keyframes are not.
        whole = fewer(max(1, len(unknowns) // settings.intervals))
    own = np.linspace(0.0, 1.0, len(whole)) if motion.u is None else whole[:, p]
    return np.ascontiguousarray(whole[:, :p]), own
