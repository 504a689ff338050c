"""Arms of many links by arms of few: a motion is found and optimised for nominal links, and laid under all of them.

The curve is the same for any number of links, so that a search for few of them says nearly all. Two bends of a joint do
not commute, so that the same curvature gives arms of other links a slightly different shape: each keyframe is fitted to
the places of the coarse arm's joints. The certificate of the arm itself decides.
"""

from dataclasses import dataclass, replace

import numpy as np

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.planning.curve_map import CurveMap
from ccm_opt.planning.goal import moved_onto
from ccm_opt.planning.motion import SpaceMotion
from ccm_opt.planning.space_sweep import failing_edges, in_pieces
from ccm_opt.planning.space_task import SpaceTask
from ccm_opt.planning.step import SpaceStepper
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.rigid_motions import NOMINAL_LINKS

_COARSE_ROOM = 0.04
"""Room that the coarse motion keeps beside the clearance [u]."""
_OFFSET = 0.02
"""Bends of the start that no curve shows, beyond which nothing is lifted [rad]."""
_FITS = 20
"""Most steps by which an arm is laid on another."""
_RIDGE = 0.0001
"""Least damping of them, in the squares of nominal links by unknowns."""
_NEAR = 0.1
"""How far its joints may be off for another beginning not to be tried [u]."""
_WORTH = 0.01
"""Share of the squared distances that a step gains, below which it is the last."""

_MOST_LINKS = 36
"""Arms of no more links are planned as they are."""
_TIME_SHARE = 0.4
"""Of the time that is left, which the search for nominal links may take."""

_MOST_BEND = 0.9
"""Bound on the bends of the coarse arm's joints [rad]."""
_RAISED_RIDGE = 1e-2
"""To which it is raised at once by a step that gains nothing."""
_RIDGE_RISE = 10.0
"""Its further rise by such steps, and its fall by others."""


def coarse_task(task: SpaceTask) -> SpaceTask | None:
    """What the search is asked for nominal links; None where the arm's own links are to be planned.

    Args:
        task: with a goal for the tip, or else nothing is lifted.
    """
    arm = task.arm
    # The user's terms are written in the bends of the arm's own joints.
    if task.goal is None or task.user is not None or arm.links <= _MOST_LINKS:
        return None
    curve, start = CurveMap.through(arm, task.start)
    if float(np.max(np.abs(curve.offset), initial=0.0)) > _OFFSET:
        return None
    coarse = coarse_arm(arm)
    straight = np.concatenate((np.zeros(2 * coarse.links), task.start[2 * arm.links :]))
    through = CurveMap.through(coarse, np.zeros(len(coarse.coordinates)))[0]
    of_coarse = replace(task, arm=coarse, start=straight).stepper(through, 0.0)
    points = _Along.coarse_joints(arm.links).of(arm.joint_positions_at(task.start))
    same_curve = start * curve.scale / of_coarse.curve.scale
    kept = _COARSE_ROOM * task.unit
    begun = _nearest(of_coarse, _Along.joints(NOMINAL_LINKS), points, same_curve)
    return replace(
        task,
        arm=coarse,
        start=of_coarse.curve.configuration(begun.v),
        clearance=task.clearance + kept,
        wanted_gap=max(task.wanted_gap - kept, 0.0),
        slowness=np.concatenate((np.ones(2 * coarse.links), task.slowness[2 * arm.links :])),
        deadline=task.deadline.within(_TIME_SHARE * task.deadline.left),
    )


def lifted_motion(task: SpaceTask, found: SpaceMotion) -> SpaceMotion | None:
    """A motion for nominal links laid under those of the arm; None where that does not pass.

    Args:
        task: of the arm.
        found: of the task that ``coarse_task`` makes of it.
    """
    curve, start = CurveMap.through(task.arm, task.start, found.curve.knots)
    stepper = task.stepper(curve, 0.0)
    unknowns = _fitted(stepper, found, start)
    if task.goal is None:
        return None
    end = moved_onto(curve, task.goal, stepper.pose(unknowns[-1]))
    if not task.goal.on_goal(end):
        return None
    unknowns = np.vstack((unknowns[:-1], end.v))
    if len(failing_edges(stepper, unknowns)) > 0:
        return None
    configurations = curve.configurations(in_pieces(stepper, unknowns))
    return SpaceMotion(curve, unknowns, configurations, f"{found.candidate}, lifted from {found.curve.arm.links} links")


def coarse_arm(arm: Arm) -> Arm:
    """The arm with nominal links, which bend as much over the same length as far as they may.

    What it weighs does not matter to the search, so that its mass is spread evenly.
    """
    links = NOMINAL_LINKS
    share = arm.links / links
    return replace(
        arm,
        links=links,
        link_length=arm.length / links,
        joint_limit=min(arm.joint_limit * arm.links / links, _MOST_BEND),
        masses=np.full(links, share * float(np.mean(arm.masses))),
        inertia_axial=np.full(links, share * float(np.mean(arm.inertia_axial))),
        inertia_transverse=np.full(links, share * float(np.mean(arm.inertia_transverse))),
        rotor_inertia=0.0,
        friction=0.0,
        clamped_joints=int(np.ceil(arm.clamped_joints / arm.links * links)),
    )


def _fitted(stepper: SpaceStepper, found: SpaceMotion, start: FloatArray) -> FloatArray:
    """Unknowns of the arm at the keyframes of a coarse motion, its joints nearest to where those of that are.

    Args:
        stepper: of the arm.
        found: the coarse motion.
        start: unknowns of the arm at its start, shape (p,).
    """
    along = _Along.coarse_joints(stepper.curve.arm.links)
    scale = found.curve.scale / stepper.curve.scale
    shared = len(scale)
    fitted = [start]
    changes = np.diff(found.unknowns, axis=0)[:, :shared] * scale
    configurations = found.curve.configurations(found.unknowns)[1:]
    joints = found.curve.arm.joint_positions_at(configurations)
    for q, places, change in zip(configurations, joints, changes, strict=True):
        # What the coarse arm changed is a good beginning where nothing is blended in to its bends. Where many joints
        # are bent, the curve that shows their bends best is a better one.
        laid = _nearest(stepper, along, places, fitted[-1] + change)
        if laid.off > _NEAR:
            same_curve = found.curve.fitted(q)[:shared] * scale
            other = _nearest(stepper, along, places, same_curve)
            laid = min(laid, other, key=lambda each: each.off)
        fitted.append(laid.v)
    return np.stack(fitted)


@dataclass(frozen=True, eq=False)
class _Laid:
    """An arm laid on places.

    Attributes:
        v: its unknowns, shape (p,).
        off: how far it is off at most [u].
    """

    v: FloatArray
    off: float


@dataclass(frozen=True, eq=False)
class _Along:
    """Places along an arm: on which link each lies, and how much of the link lies before it.

    Attributes:
        link: shape (m,).
        share: shape (m,).
    """

    link: IntArray
    share: FloatArray

    @classmethod
    def coarse_joints(cls, links: int) -> "_Along":
        """Where the joints and the tip of the coarse arm lie along an arm of so many links."""
        along = np.linspace(0.0, float(links), NOMINAL_LINKS + 1)
        link = np.minimum(along.astype(np.intp), links - 1)
        return cls(link, along - link)

    @classmethod
    def joints(cls, links: int) -> "_Along":
        """The joints and the tip of an arm of so many links themselves."""
        link = np.minimum(np.arange(links + 1), links - 1)
        return cls(link, (np.arange(links + 1) - link).astype(np.float64))

    def of(self, values: FloatArray) -> FloatArray:
        """Values at these places, by those of the joints and the tip, linear in between, shape (links + 1, ...)."""
        share = self.share.reshape(-1, *(1,) * (values.ndim - 1))
        return np.asarray((1.0 - share) * values[self.link] + share * values[self.link + 1])


def _nearest(stepper: SpaceStepper, along: _Along, wanted: FloatArray, v: FloatArray) -> _Laid:
    """The arm that comes nearest to places, fed as far, by the method of Levenberg and Marquardt.

    Args:
        stepper: of the arm.
        along: where on the arm.
        wanted: where these shall be, shape (m, 3) [m].
        v: unknowns to begin at, shape (p,).
    """
    pose = stepper.pose(v)
    missing = ((wanted - along.of(pose.points)) / stepper.unit).ravel()
    ridge = _RIDGE
    for _ in range(_FITS):
        rows = along.of(pose.moving).reshape(len(missing), -1) / stepper.unit
        if stepper.curve.arm.base_axes:
            rows[:, stepper.curve.feed_column] = 0.0
        step = np.linalg.solve(rows.T @ rows + ridge * np.eye(len(pose.v)), rows.T @ missing)
        trial = stepper.pose(pose.v + step)
        left = ((wanted - along.of(trial.points)) / stepper.unit).ravel()
        gained = float(missing @ missing - left @ left)
        if not gained > 0.0:
            ridge = _RIDGE_RISE * max(ridge, _RAISED_RIDGE)
            continue
        settled = gained < _WORTH * float(missing @ missing)
        pose = trial
        missing = left
        ridge = max(ridge / _RIDGE_RISE, _RIDGE)
        if settled:
            break
    return _Laid(pose.v, float(np.max(np.linalg.norm(missing.reshape(-1, 3), axis=1))))
