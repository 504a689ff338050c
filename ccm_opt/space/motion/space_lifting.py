"""Arms of many links by arms of few: a motion is found and optimised for nominal links, and laid under all of them.

The curve is the same for any number of links, so that a search for few of them says nearly all. Two bends of a joint do
not commute, so that the same curvature gives arms of other links a slightly different shape: each keyframe is fitted to
the places of the coarse arm's joints. The certificate of the arm itself decides.
"""

from dataclasses import replace

import numpy as np

from ccm_opt.ground.arrays import FloatArray
from ccm_opt.jointed.space_arm import SpaceArm
from ccm_opt.space.curve.nominal_links import NOMINAL_LINKS
from ccm_opt.space.motion.chain import Chains
from ccm_opt.space.motion.curve_map import CurveMap
from ccm_opt.space.motion.pieces import failing_edges, in_pieces
from ccm_opt.space.motion.settings.space_lifting_settings import LiftingSettings
from ccm_opt.space.motion.space_goal import onto_goal
from ccm_opt.space.motion.space_step import SpaceStepper
from ccm_opt.space.motion.task import SpaceMotion, SpaceTask


def coarse_task(task: SpaceTask) -> SpaceTask | None:
    """What the search is asked for nominal links; None where the arm's own links are to be planned.

    Args:
        task: with a goal for the tip, or else nothing is lifted.
    """
    settings = task.settings.lifting
    arm = task.arm
    # The user's terms are written in the bends of the arm's own joints.
    if task.goal is None or task.user is not None or arm.links <= settings.most_links:
        return None
    curve, start = CurveMap.through(arm, task.start)
    if float(np.max(np.abs(curve.offset), initial=0.0)) > settings.offset:
        return None
    coarse = coarse_arm(arm, settings)
    coarse_curve, _ = CurveMap.through(coarse, np.zeros(len(coarse.coordinates)))
    return replace(
        task,
        arm=coarse,
        start=coarse_curve.configuration(start * curve.scale / coarse_curve.scale),
        clearance=task.clearance + settings.clearance * task.unit,
        slowness=np.concatenate((np.ones(2 * coarse.links), task.slowness[2 * arm.links :])),
        deadline=task.deadline.within(settings.time_share * task.deadline.left),
    )


def lifted_motion(task: SpaceTask, found: SpaceMotion) -> SpaceMotion | None:
    """A motion for nominal links laid under those of the arm; None where that does not pass.

    Args:
        task: of the arm.
        found: of the task that ``coarse_task`` makes of it.
    """
    curve, start = CurveMap.through(task.arm, task.start, found.curve.knots)
    stepper = task.stepper(curve, 0.0)
    unknowns = _fitted(stepper, found, start, task.settings.lifting)
    end = None if task.goal is None else onto_goal(stepper, task.goal, stepper.pose(unknowns[-1]))
    if end is None:
        return None
    unknowns = np.vstack((unknowns[:-1], end.v))
    if len(failing_edges(stepper, unknowns)) > 0:
        return None
    configurations = curve.configurations(in_pieces(stepper, unknowns))
    return SpaceMotion(curve, unknowns, configurations, f"{found.candidate}, lifted from {found.curve.arm.links} links")


def coarse_arm(arm: SpaceArm, settings: LiftingSettings) -> SpaceArm:
    """The arm with nominal links, which bend as much over the same length as far as they may.

    What it weighs does not matter to the search, so that its mass is spread evenly.
    """
    links = NOMINAL_LINKS
    share = arm.links / links
    return replace(
        arm,
        links=links,
        link_length=arm.length / links,
        joint_limit=min(arm.joint_limit * arm.links / links, settings.most_bend),
        masses=np.full(links, share * float(np.mean(arm.masses))),
        inertia_axial=np.full(links, share * float(np.mean(arm.inertia_axial))),
        inertia_transverse=np.full(links, share * float(np.mean(arm.inertia_transverse))),
        rotor_inertia=0.0,
        friction=0.0,
    )


def _fitted(stepper: SpaceStepper, found: SpaceMotion, start: FloatArray, settings: LiftingSettings) -> FloatArray:
    """Unknowns of the arm at the keyframes of a coarse motion, its joints nearest to where those of that are.

    Args:
        stepper: of the arm.
        found: the coarse motion.
        start: unknowns of the arm at its start, shape (p,).
        settings: of lifting.
    """
    links = stepper.curve.arm.links
    chains = Chains(found.curve.arm)
    # Places along the arm at which the coarse one has joints, as joints and shares of a link.
    along = np.linspace(0.0, float(links), NOMINAL_LINKS + 1)
    low = np.minimum(along.astype(np.intp), links - 1)
    share = along - low
    scale = found.curve.scale / stepper.curve.scale
    shared = len(scale)  # what a goal is blended in by is the coarse arm's own
    fitted = [start]
    for before, v in zip(found.unknowns[:-1], found.unknowns[1:], strict=True):
        wanted, _ = chains.places(found.curve.configuration(v))
        # What the coarse arm changed is a good beginning.
        now = fitted[-1] + (v - before)[:shared] * scale
        for _ in range(settings.fits):
            pose = stepper.pose(now)
            points = pose.chain.points
            moving = pose.chain.moving
            at = (1.0 - share)[:, None] * points[low] + share[:, None] * points[low + 1]
            slopes = (1.0 - share)[:, None, None] * moving[low] + share[:, None, None] * moving[low + 1]
            rows = slopes.reshape(-1, len(now)) / stepper.unit
            missing = ((wanted - at) / stepper.unit).ravel()
            normal = rows.T @ rows + settings.ridge * np.eye(len(now))
            now = now + np.linalg.solve(normal, rows.T @ missing)
        fitted.append(now)
    return np.stack(fitted)
