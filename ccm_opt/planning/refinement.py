"""Motions of arms with many links, planned with few links and then refined to the arm's own links.

The continuous curve does not depend on the number of links, so a search with few links suffices. In the plane the
coordinates are kept, and intervals that fail the certificate are repaired. In space the two bends of a joint do not
commute, so the same curvature gives arms with different numbers of links slightly different shapes; therefore each
keyframe is fitted to the joint positions of the coarse arm. A refined motion is accepted only if it is certified for
the arm itself.
"""

from dataclasses import dataclass, replace
from itertools import chain
from math import ceil

import numpy as np

from ccm_opt.core.arrays import BoolArray, FloatArray, IntArray
from ccm_opt.planning.curve_map import CurveMap
from ccm_opt.planning.ending import optimised_to_end_pose
from ccm_opt.planning.goal import moved_onto
from ccm_opt.planning.link_space import LinkSpace, mean_heading_matrix
from ccm_opt.planning.motion import Motion, SpaceMotion
from ccm_opt.planning.motion_task import MotionTask, coarsened
from ccm_opt.planning.optimisation.optimise import optimise
from ccm_opt.planning.passage_widths import fitting_margins
from ccm_opt.planning.pose import Pose, Term
from ccm_opt.planning.search import Failure
from ccm_opt.planning.search_run import PlanarRun
from ccm_opt.planning.shortcuts import straightened
from ccm_opt.planning.space_task import SpaceTask
from ccm_opt.planning.step import SpaceStepper, Stepper
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.rigid_motions import NOMINAL_LINKS

_REACH = 0.02
"""Gap up to which contacts are constraints of a repair step, as a fraction of the arm's length. Heuristic."""
_COORDINATE_WEIGHT = 1e-4
"""Weight of changes of the coordinates relative to those of link headings. It fixes coordinates on which no link
heading depends. Heuristic."""

_REPAIRS = 6
"""Maximum number of rounds that repair keyframes of intervals that fail the certificate. Heuristic; if these do not
suffice, planning is repeated with the task's own links."""
_DESIGN_LINKS = 24
"""Number of links with which arms of more links are planned; more if narrow passages require it. Measured: of 38
motions found in clutter with this many links, 34 were certified unchanged for arms with more links."""
_MANY_LINKS = 1.5
"""Multiple of the coarse arm's number of links above which planning with the coarse arm pays. Heuristic."""
REFINEMENT_MARGIN = 3e-3
"""Margin kept in the optimisation of a motion that is to be refined, as a fraction of the arm's length. Heuristic:
about the distance of an arm of 24 links from its curve."""
_REPAIR_MARGIN = 1.5e-3
"""Planning margin of the repair of a refined motion, as a fraction of the arm's length. Heuristic."""
_COARSE_ROOM = 0.04
"""Gap that the motion of the coarse arm in space keeps beyond the required clearance, in nominal links."""
_OFFSET = 0.02
"""Largest difference between the bends of the start and of its fitted curve for a motion in space to be refined
[rad]."""
_FITS = 20
"""Maximum number of Levenberg-Marquardt steps that fit an arm to joint positions."""
_RIDGE = 0.0001
"""Minimum damping of the Levenberg-Marquardt steps, for errors in nominal links."""
_NEAR = 0.1
"""Position error of the fitted joints above which a second initial guess is tried, in nominal links."""
_WORTH = 0.01
"""Fraction by which a step of the fit has to reduce the sum of squared errors for another step to follow."""

_MOST_LINKS = 36
"""Maximum number of links of an arm that is planned with its own links in space."""
_TIME_SHARE = 0.4
"""Fraction of the remaining time that the search with nominal links may take."""

_BEND_SHARE = 0.94
"""Fraction of the joint limit up to which joints are bent in a second fit, if the first one is not certified.
Heuristic: where a coarse arm was optimised up to its limit, a fit, or moving its end onto the goal, exceeds the limit
by a few hundredths."""
_BEND_WEIGHT = 3.0
"""Weight of a bend's excess in the fit [1/rad], beside position errors in nominal links. Heuristic."""
_MOST_BEND = 0.9
"""Largest joint limit that a coarse arm gets [rad]."""
_RAISED_RIDGE = 1e-2
"""Value to which a smaller damping of the fit is raised, before it is multiplied by ``_RIDGE_RISE``, after a step that
does not reduce the error."""
_RIDGE_RISE = 10.0
"""Factor by which the fit's damping rises after a step that does not reduce the error, and falls otherwise."""


def refine_motion(motion: Motion, task: MotionTask) -> Motion | None:
    """Return the motion refined to the task's own links and certified; None if that fails.

    The keyframes' coordinates are kept, but the map from coordinates to configurations is built anew for the task's
    links, so that the start is met exactly. The last keyframe is moved onto the goal. Keyframes of intervals that fail
    the certificate are moved by QP steps, in a few rounds.
    """
    space = _space_of_all_links(motion, task)
    coordinates = motion.unknowns.copy()
    # With other links the same coordinates move the tip slightly; the space itself meets a goal of the whole arm.
    if task.goal_pose is None:
        goal = task.limited_goal
        end = moved_onto(space, goal, space.pose(coordinates[-1]))
        if not goal.on_goal(end):
            return None
        coordinates[-1] = end.v

    stepper = _repair_stepper(space, task)
    failing = task.failures(space, coordinates)
    if _lies_across(stepper, coordinates, failing):
        return None
    for _ in range(_REPAIRS):
        if len(failing) == 0:
            break
        # A step moves keyframes, not intervals: both keyframes of an interval are moved.
        at_both_ends = np.unique(np.concatenate((failing, failing + 1)))
        coordinates = _pushed_clear(stepper, coordinates, at_both_ends)
        failing = task.failures(space, coordinates)
    if len(failing):
        return None
    q = space.configurations(coordinates)
    return Motion(space, coordinates, q, f"{motion.candidate}, lifted", end_pose=motion.end_pose)


def _resampled_columns(columns: FloatArray, links: int) -> FloatArray:
    """Return values per link, shape (m, k), interpolated along the arm to another number of links, (links, k)."""
    resampled = [_resampled(column, links) for column in columns.T]
    return np.column_stack(resampled) if resampled else np.zeros((links, 0))


def _space_of_all_links(motion: Motion, task: MotionTask) -> LinkSpace:
    """Return the link space of the task's arm in which the motion's first coordinates give the task's start.

    A motion with a blended end has one more coordinate w, which is 1 at the end that is given for the whole arm (the
    goal, or the start of a motion planned backwards) and 0 at the other end.
    """
    arm = task.arm
    matrix = mean_heading_matrix(arm)
    p = matrix.shape[1]
    first = motion.unknowns[0]
    last = motion.unknowns[-1]
    start = arm.headings(task.start)
    if task.goal_pose is not None:
        # The column that blends from one end to the other is rebuilt, so that both are met exactly. A motion deformed
        # to another end for more clearance has further coordinates: their columns are resampled.
        columns = np.column_stack((matrix, _resampled_columns(motion.curve.turns[:, p:], arm.links)))
        change = last - first
        k = p + int(np.argmax(np.abs(change[p:])))
        columns[:, k] = 0.0
        before = start - columns @ first
        behind = arm.headings(task.goal_pose) - columns @ last
        columns[:, k] = (behind - before) / change[k]
        return _refined_space(arm, columns, before - first[k] * columns[:, k])

    if len(first) > p and first[-1] != 0.0:
        offset = _resampled(motion.curve.arm.headings(motion.curve.offset), arm.links)
        return _refined_space(arm, np.column_stack((matrix, start - matrix @ first[:p] - offset)), offset)
    # Any blending leads to an end that was chosen for the coarse arm: its column is resampled, and the start is met
    # exactly.
    columns = np.column_stack((matrix, _resampled_columns(motion.curve.turns[:, p:], arm.links)))
    return _refined_space(arm, columns, start - columns @ first)


def _refined_space(arm: Arm, turns: FloatArray, offset: FloatArray) -> LinkSpace:
    """Return the link space in which link headings [rad] are ``offset`` (links,) plus ``turns`` (links, p) times v."""
    return LinkSpace(arm, np.diff(turns, axis=0, prepend=0.0), arm.bends(offset))


def _resampled(offset: FloatArray, links: int) -> FloatArray:
    """Return link headings (m,) interpolated along the arm to another number of links, shape (links,) [rad]."""
    # An offset belongs to the middle of its link; beyond the outermost middles it is held constant.
    middles = (np.arange(len(offset)) + 0.5) / len(offset)
    wanted = (np.arange(links) + 0.5) / links
    return np.interp(wanted, middles, offset)


def _repair_stepper(space: LinkSpace, task: MotionTask) -> Stepper:
    """Return the solver of QP steps for repairs, with a smaller margin than that of the search."""
    length = task.arm.length
    finder = task.finder(_REPAIR_MARGIN * length, _REACH * length)
    return Stepper(space, task.limits(finder), task.settings, finder=finder)


def _lies_across(stepper: Stepper, coordinates: FloatArray, failing: IntArray) -> bool:
    """Return whether the centre line of the arm crosses a wall or itself at the start of an interval that failed.

    No repair can undo that.

    Args:
        stepper: solver of the repair's QP steps.
        coordinates: coordinates of the keyframes, shape (K, p).
        failing: indices of failing intervals.
    """
    poses = (stepper.pose(coordinates[k]) for k in failing)
    return any(stepper.finder.crosses(pose.points) for pose in poses)


def _pushed_clear(stepper: Stepper, coordinates: FloatArray, keyframes: IntArray) -> FloatArray:
    """Return coordinates (K, p) in which given keyframes are moved out of the planning margin; first and last stay.

    Each keyframe is moved by one QP step that otherwise minimises the change.
    """
    space = stepper.space
    last = len(coordinates) - 1
    mended = coordinates.copy()
    for k in keyframes:
        if k in {0, last}:
            continue  # the ends are given
        pose = stepper.pose(coordinates[k])
        stay = [
            Term(space.turns, np.zeros(space.arm.links), space.nominal_per_link),
            Term(np.eye(len(pose.v)), np.zeros(len(pose.v)), _COORDINATE_WEIGHT),
        ]
        mended[k] = stepper.step(pose, stay).v
    return mended


def coarse_task(task: MotionTask) -> MotionTask | None:
    """Return a planar task for an arm of the same length with as few links as the passages permit, or None.

    The result is None if planning with fewer links does not pay or is not possible: with user limits, a clamped base, a
    feed axis, links of different lengths, or gates.
    """
    # Narrow passages need short links.
    links = max(_DESIGN_LINKS, 2 * ceil(0.5 * task.nominal_links))
    if (
        task.arm.links <= _MANY_LINKS * links
        or task.user_limits
        or task.clamped
        or task.arm.base_axes
        or task.arm.proportions
    ):
        return None
    # A motion on the middle line of a gate with few links is off that line with many.
    if task.gates is not None:
        return None
    return coarsened(task, links)


def taken_over(found: Motion, coarse: MotionTask, task: MotionTask, failures: list[Failure]) -> Motion | None:
    """Return an optimised motion of the task's own arm, derived from a motion of the coarse arm.

    The coarse motion is refined; if that fails, the candidate that found it is repeated with the own arm.

    Args:
        found: motion of the coarse arm.
        coarse: its task.
        task: task with its own links.
        failures: list to which failures are appended.

    Returns:
        None if both methods fail.
    """
    refined = _refined(found, coarse, task)
    if refined is not None:
        return refined
    again = _found_again(found, task, failures)
    return optimised_to_end_pose(straightened(again, task), task) if again is not None else None


def _refined(found: Motion, coarse: MotionTask, task: MotionTask) -> Motion | None:
    """Return a coarse motion refined to the task's links, or None.

    The coarse motion is optimised and then refined; if that fails, it is refined first and then optimised.
    """
    # An optimised motion runs close to the walls, and the links of the finer arm lie elsewhere; hence the wider margin.
    # Where its refinement still fails, the motion as found has more clearance.
    optimised = optimised_to_end_pose(straightened(found, coarse), coarse, REFINEMENT_MARGIN)
    refined = refine_motion(optimised, task)
    if refined is not None or optimised is found:
        return refined
    refined = refine_motion(found, task)
    return optimise(refined, task) if refined is not None else None


def _found_again(found: Motion, task: MotionTask, failures: list[Failure]) -> Motion | None:
    """Return the motion found with the task's own links by the candidate that succeeded with few links, or None.

    In narrow passages the finer arm bulges out from the chords of the coarse arm, and no repair brings a thin link back
    through a wall; but a guide that leads one arm to the goal mostly leads the other one there, too.
    """
    run = PlanarRun.from_task(task, fitting_margins(task)[0])
    return run.run((each for each in chain(run.first(), run.further()) if each.name == found.candidate), failures)


# ------------------------------------------------------------ in space
def nominal_task(task: SpaceTask) -> SpaceTask | None:
    """Return the search task in space of a coarse arm with nominal links; None if the arm's own links are to be used.

    The own links are used for goals of the whole arm, user terms, few links, unequal or coupled links, and starts
    that the curve does not represent.

    Args:
        task: task of the arm.
    """
    arm = task.arm
    # The user's terms are written in the bends of the arm's own joints.
    own = task.user is not None or arm.proportions is not None or arm.drives is not None
    if task.goal_pose is not None or own or arm.links <= _MOST_LINKS:
        return None
    curve, start = CurveMap.through(arm, task.start)
    if float(np.max(np.abs(curve.offset), initial=0.0)) > _OFFSET:
        return None
    coarse = arm.with_links(NOMINAL_LINKS)
    coarse = replace(coarse, joint_limit=min(arm.joint_limit * arm.links / NOMINAL_LINKS, _MOST_BEND))
    straight = np.concatenate((np.zeros(2 * coarse.links), task.start[2 * arm.links :]))
    through = CurveMap.through(coarse, np.zeros(len(coarse.coordinates)))[0]
    of_coarse = replace(task, arm=coarse, start=straight).stepper(through, 0.0)
    points = _Along.coarse_joints(arm.links).interpolate(arm.joint_positions_at(task.start))
    same_curve = start * curve.scale / of_coarse.space.scale
    kept = _COARSE_ROOM * task.unit
    begun = _nearest(of_coarse, _Along.joints(NOMINAL_LINKS), points, same_curve)
    return replace(
        task,
        arm=coarse,
        start=of_coarse.space.configuration(begun.v),
        clearance=task.clearance + kept,
        wanted_gap=max(task.wanted_gap - kept, 0.0),
        slowness=np.concatenate((np.ones(2 * coarse.links), task.slowness[2 * arm.links :])),
        deadline=task.deadline.within(_TIME_SHARE * task.deadline.left),
    )


def refine_space_motion(task: SpaceTask, found: SpaceMotion) -> SpaceMotion | None:
    """Return a motion of the coarse arm refined to the arm's links; None if it misses the goal or is not certified.

    Args:
        task: task of the arm.
        found: motion for the task that ``nominal_task`` derives from it.
    """
    curve, start = CurveMap.through(task.arm, task.start, found.curve.knots)
    stepper = task.stepper(curve, 0.0)
    for share in (np.inf, _BEND_SHARE):
        unknowns = _fitted(stepper, found, start, share * task.arm.joint_limit)
        end = moved_onto(curve, task.goal, stepper.pose(unknowns[-1]))
        if not task.goal.on_goal(end):
            return None
        unknowns = np.vstack((unknowns[:-1], end.v))
        if len(stepper.failing_edges(unknowns)) == 0:
            break
    else:
        return None
    configurations = curve.configurations(stepper.space.in_pieces(unknowns))
    return SpaceMotion(curve, unknowns, configurations, f"{found.candidate}, lifted from {found.curve.arm.links} links")


def _fitted(stepper: SpaceStepper, found: SpaceMotion, start: FloatArray, most: float) -> FloatArray:
    """Return the arm's unknowns at the keyframes of a coarse motion, fitted to the coarse arm's joints, shape (K, p).

    Args:
        stepper: solver of QP steps of the arm; gives the space of unknowns.
        found: the coarse motion.
        start: unknowns of the arm at its start, shape (p,).
        most: bend up to which joints are bent where possible [rad].
    """
    along = _Along.coarse_joints(stepper.space.arm.links)
    scale = found.curve.scale / stepper.space.scale
    shared = len(scale)
    fitted = [start]
    changes = np.diff(found.unknowns, axis=0)[:, :shared] * scale
    configurations = found.curve.configurations(found.unknowns)[1:]
    joints = found.curve.arm.joint_positions_at(configurations)
    for q, places, change in zip(configurations, joints, changes, strict=True):
        # The coarse arm's change of unknowns is mostly a good initial guess. Where the fit from there is poor, the
        # curve fitted to the coarse arm's configuration is tried as well.
        laid = _nearest(stepper, along, places, fitted[-1] + change, most)
        if laid.off > _NEAR:
            same_curve = found.curve.fitted(q)[:shared] * scale
            other = _nearest(stepper, along, places, same_curve, most)
            laid = min(laid, other, key=lambda each: each.off)
        fitted.append(laid.v)
    return np.stack(fitted)


@dataclass(frozen=True, eq=False)
class _Laid:
    """Result of fitting an arm so that points on it come near given positions.

    Attributes:
        v: unknowns of the arm, shape (p,).
        off: largest distance from these positions, in nominal links.
    """

    v: FloatArray
    off: float


@dataclass(frozen=True, eq=False)
class _Along:
    """Points along an arm, each given by its link and the fraction of the link's length before the point.

    Attributes:
        link: indices of the links, shape (m,).
        share: fractions of the links' lengths, in [0, 1], shape (m,).
    """

    link: IntArray
    share: FloatArray

    @classmethod
    def coarse_joints(cls, links: int) -> "_Along":
        """Return the points on an arm of ``links`` links that match the joints and tip of one with nominal links."""
        along = np.linspace(0.0, float(links), NOMINAL_LINKS + 1)
        link = np.minimum(along.astype(np.intp), links - 1)
        return cls(link, along - link)

    @classmethod
    def joints(cls, links: int) -> "_Along":
        """Return the joints and the tip of an arm with the given number of links."""
        link = np.minimum(np.arange(links + 1), links - 1)
        return cls(link, (np.arange(links + 1) - link).astype(np.float64))

    def interpolate(self, values: FloatArray) -> FloatArray:
        """Return the values at these points, shape (m, ...), interpolated linearly from those at joints and tip."""
        share = self.share.reshape(-1, *(1,) * (values.ndim - 1))
        return np.asarray((1.0 - share) * values[self.link] + share * values[self.link + 1])


def _nearest(stepper: SpaceStepper, along: _Along, wanted: FloatArray, v: FloatArray, most: float = np.inf) -> _Laid:
    """Return the unknowns at which points on an arm come nearest to given positions, and the largest distance left.

    The axes that carry the base are fixed; the method is Levenberg-Marquardt.

    Args:
        stepper: solver of QP steps of the arm; gives the space of unknowns.
        along: points on the arm.
        wanted: positions that these points should have, shape (m, 3) [m].
        v: initial unknowns, shape (p,).
        most: bend beyond which joints cost, besides points that miss their positions [rad].
    """
    space = stepper.space

    def residuals(pose: Pose) -> tuple[FloatArray, BoolArray]:
        missing = (wanted - along.interpolate(pose.points)) / space.nominal_length
        bends = space.bends(pose.q)
        beyond = np.abs(bends) > most
        excess = np.clip(bends[beyond], -most, most) - bends[beyond]
        return np.concatenate((missing.ravel(), _BEND_WEIGHT * excess)), beyond

    pose = stepper.pose(v)
    left, beyond = residuals(pose)
    ridge = _RIDGE
    for _ in range(_FITS):
        rows = along.interpolate(pose.moving).reshape(wanted.size, -1) / space.nominal_length
        if np.any(beyond):
            rows = np.vstack((rows, _BEND_WEIGHT * space.bend_slopes(pose)[beyond]))
        rows[:, space.axis_columns] = 0.0
        step = np.linalg.solve(rows.T @ rows + ridge * np.eye(len(pose.v)), rows.T @ left)
        trial = stepper.pose(pose.v + step)
        after, beyond_after = residuals(trial)
        gained = float(left @ left - after @ after)
        if not gained > 0.0:
            ridge = _RIDGE_RISE * max(ridge, _RAISED_RIDGE)
            continue
        settled = gained < _WORTH * float(left @ left)
        pose, left, beyond = trial, after, beyond_after
        ridge = max(ridge / _RIDGE_RISE, _RIDGE)
        if settled:
            break
    missing = left[: wanted.size].reshape(-1, 3)
    return _Laid(pose.v, float(np.max(np.linalg.norm(missing, axis=1))))
