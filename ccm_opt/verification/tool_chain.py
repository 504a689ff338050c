"""The verifier's own model of a tool: further parts of the chain behind the last link, which never turn against it.

Each body of the tool is a straight part of the chain. The parts that lead from one body to the next, and on to the
tool's tip, have no body and are compared with nothing. ``scene.tool_links`` models tools likewise, for planning; the
verifier deliberately does not use it.
"""

from dataclasses import replace
from itertools import pairwise

import numpy as np

from ccm_opt.core.arrays import BoolArray, FloatArray
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.link_layout import Proportions
from ccm_opt.robot.tool import ToolLinks
from ccm_opt.verification.chain_motion import ChainMotion

_BALL = 1e-4
"""Length of the axis that a body without length gets, in link lengths. Heuristic."""
_SAME = 1e-9
"""Distance of places that count as one, in link lengths. Derived: rounding."""
_NEIGHBOURS = 0.05
"""Gap to the straight arm's links up to which a body counts as near them around a bend, as a fraction of the sum of
both radii; that of ``scene.tool_links``."""


def motion_of(arm: Arm, time: FloatArray, positions: FloatArray, deviation: FloatArray | None = None) -> ChainMotion:
    """Return the motion of an arm with its tool, from the arm's coordinates.

    Args:
        arm: the arm.
        time: sample times, shape (T,) [s].
        positions: coordinates at the samples, shape (T, c) [rad, m].
        deviation: bound on how far each link may be from this motion in each step, the last with the tool, shape
            (T − 1, links) [m]; None if the motion is exact.
    """
    if arm.tool is None:
        return ChainMotion(arm, time, positions, deviation)
    whole = arm_with_tool(arm)
    still = np.zeros((len(positions), (whole.links - arm.links) * arm.bends_a_joint))
    bends = arm.coordinates.joints
    if deviation is not None:
        deviation = np.pad(deviation, [(0, 0), (0, whole.links - arm.links)], mode="edge")
    longer = np.concatenate((positions[:, :bends], still, positions[:, bends:]), axis=1)
    return ChainMotion(whole, time, longer, deviation)


def arm_reaching_tool(arm: Arm) -> Arm:
    """Return an arm without a tool whose last link is so long that no point of the tool is farther from its joint."""
    if arm.tool is None:
        return arm
    places = [arm.tool.tip, *(place for body in arm.tool.bodies for place in (body.start, body.end))]
    lengths = arm.lengths.copy()
    lengths[-1] += max(float(np.linalg.norm(place)) for place in places)
    mean, none = float(lengths.mean()), np.ones(arm.links * arm.bends_a_joint)
    proportions = arm.proportions or Proportions(lengths, np.ones(arm.links), none)
    return replace(arm, tool=None, link_length=mean, proportions=replace(proportions, lengths=lengths / mean))


def arm_with_tool(arm: Arm) -> Arm:
    """Return the arm with its tool as further parts of the chain; the arm must have a tool."""
    tool = arm.tool
    assert tool is not None  # noqa: S101 - by contract
    unit = arm.link_length
    place = np.zeros(len(tool.tip))
    steps: list[FloatArray] = []
    radii: list[float] = []
    has_body: list[bool] = []
    for body in tool.bodies:
        one, other = body.start, body.end
        if float(np.linalg.norm(one - other)) < _BALL * unit:
            beside = 0.5 * _BALL * unit * np.eye(len(place))[0]
            one, other = one - beside, one + beside
        for goal, radius in ((one, -1.0), (other, body.radius)):
            if float(np.linalg.norm(goal - place)) > _SAME * unit:
                steps.append(goal - place)
                radii.append(max(radius, 0.0))
                has_body.append(radius >= 0.0)
                place = goal
    if float(np.linalg.norm(tool.tip - place)) > _SAME * unit:
        steps.append(tool.tip - place)
        radii.append(0.0)
        has_body.append(False)
    return _lengthened(arm, tool.direction, np.reshape(steps, (-1, len(place))), np.array(radii), np.array(has_body))


def _lengthened(arm: Arm, direction: FloatArray, steps: FloatArray, radii: FloatArray, has_body: FloatArray) -> Arm:
    """Return an arm with k further parts, whose vectors are given in the frame of the last link, shape (k, d) [m]."""
    k = len(steps)
    lengths = np.concatenate((arm.lengths, np.sqrt(np.sum(steps**2, axis=1))))
    thick = np.concatenate((arm.radii, radii))
    mean, widest = float(lengths.mean()), float(thick.max())
    each = arm.bends_a_joint
    limits = np.ones(each * arm.links) if arm.proportions is None else arm.proportions.limits
    links = ToolLinks(
        count=k,
        turns=_relative_turns(arm, steps),
        bare=np.concatenate((np.zeros(arm.links, dtype=bool), ~has_body.astype(bool))),
        distant=_compared(arm, steps, radii, has_body.astype(bool)),
        near_shares=np.concatenate(([0.0], np.cumsum(lengths))) / mean,
        direction=direction,
    )
    some = np.full(k, 1.0)
    return replace(
        arm,
        links=arm.links + k,
        link_length=mean,
        radius=widest,
        masses=np.append(arm.masses, some),
        inertia_axial=np.append(arm.inertia_axial, some),
        inertia_transverse=np.append(arm.inertia_transverse, some),
        proportions=Proportions(lengths / mean, thick / (widest or 1.0), np.append(limits, np.zeros(each * k))),
        tool=None,
        tool_links=links,
    )


def _relative_turns(arm: Arm, steps: FloatArray) -> FloatArray:
    """Return the turn of each part against the one before it; links of the arm have none.

    Angles, shape (links + k,) [rad], in the plane; rotations, shape (links + k, 3, 3), in space.
    """
    if steps.shape[1] == 2:
        before = np.vstack(([[1.0, 0.0]], steps[:-1]))
        sine = before[:, 0] * steps[:, 1] - before[:, 1] * steps[:, 0]
        return np.concatenate((np.zeros(arm.links), np.arctan2(sine, np.sum(before * steps, axis=1))))
    frames = [np.eye(3)]
    for step in steps:
        # Householder: the reflection that swaps x with the direction, and a second one that makes it a rotation.
        along = step / np.linalg.norm(step)
        sign = -1.0 if along[0] > 0.0 else 1.0
        normal = sign * along - np.eye(3)[0]
        reflection = np.eye(3) - 2.0 * np.outer(normal, normal) / (normal @ normal)
        frames.append(reflection @ np.diag([sign, 1.0, -sign]))
    relative = [before.T @ after for before, after in pairwise(frames)]
    return np.concatenate((np.tile(np.eye(3), (arm.links, 1, 1)), relative))


def _compared(arm: Arm, steps: FloatArray, radii: FloatArray, has_body: BoolArray) -> BoolArray:
    """Return a mask of the pairs of a link and a later part of the chain that must stay apart, (links + k, links + k).

    Links of the arm stay apart as they do without a tool. A link before the last two stays apart from every body of the
    tool that is not near it while the arm is straight.
    """
    from ccm_opt.verification.selfcollision import far_along_arm, segment_distances  # noqa: PLC0415 - which imports this

    count = arm.links + len(steps)
    compared = np.zeros((count, count), dtype=bool)
    compared[: arm.links, : arm.links] = far_along_arm(arm)
    corners = np.concatenate((np.zeros((1, steps.shape[1])), np.cumsum(steps, axis=0)))
    ends = np.cumsum(arm.lengths) - np.sum(arm.lengths)
    for link in range(arm.links - 2):
        one, other = np.zeros((2, len(steps), steps.shape[1]))
        one[:, 0], other[:, 0] = ends[link] - arm.lengths[link], ends[link]
        apart = segment_distances(one, other, corners[:-1], corners[1:])
        both = arm.radii[link] + radii
        compared[link, arm.links :] = has_body & (apart - both > _NEIGHBOURS * both)
    return compared
