"""Checks of start and goal poses: contacts, and torques needed to hold the arm."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from ccm_opt.core.arrays import ROUNDING, FloatArray
from ccm_opt.core.errors import Finding
from ccm_opt.core.length_words import place as at
from ccm_opt.core.length_words import short_length
from ccm_opt.diagnosis.gaps import Gaps, ObstacleGap, gaps_of
from ccm_opt.diagnosis.named_goals import NamedPose, NamedTipGoal, named_poses, named_tip_goals
from ccm_opt.diagnosis.ranking import point
from ccm_opt.diagnosis.sections import link_words, section_at
from ccm_opt.dynamics.runtime.inverse_dynamics import InverseDynamics
from ccm_opt.problem import Problem
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.frames import drive_torque_limits, drive_torques, joint_names, revolute_angles
from ccm_opt.scene.distances.enclosures import segment_distances

_TOUCHING = 1e-6
"""Overlap that proofs do not count as contact, and by which they widen passages, as a fraction of the arm's length.

Derived: of the order of the verifier's tolerances, and above all rounding.
"""


def contact_at_poses(problem: Problem) -> Iterator[Finding]:
    """Yield findings for each required pose: one per obstacle that the arm touches, the deepest contact first.

    If links of the arm touch each other in the pose, another finding follows.
    """
    gaps = gaps_of(problem.workspace)
    for pose in named_poses(problem):
        yield from _deepest_first(_touched_by_links(problem, gaps, pose))
        yield from _self_touched(problem.arm, pose)


def contact_at_tips(problem: Problem) -> Iterator[Finding]:
    """Yield a finding per obstacle that the tip, or the last link, touches at a tip goal, deepest first."""
    gaps = gaps_of(problem.workspace)
    for place in named_tip_goals(problem):
        yield from _deepest_first(_touched_by_tip(problem, gaps, place))


def _deepest_first(findings: Iterator[Finding]) -> list[Finding]:
    return sorted(findings, key=lambda finding: -(finding.measured or 0.0))


def touching_overlap(arm: Arm) -> float:
    """Return the overlap that proofs do not count as contact [m], to allow for touching and rounding errors."""
    return _TOUCHING * arm.length


def _touched_by_links(problem: Problem, gaps: Gaps, pose: NamedPose) -> Iterator[Finding]:
    """Yield a finding per obstacle that the arm touches in a pose, at the link with the greatest overlap."""
    arm = problem.arm
    first, segments = arm.exposed_links(arm.joint_positions_at(pose.q))
    if not len(segments):
        return
    needs = arm.radii[first:] + problem.workspace.clearance
    for found in gaps.touched(segments, float(np.max(needs))):
        # One finding per obstacle; it is proved if the goal's tolerances cannot free all links.
        k = int(np.argmin(found.gaps - needs))
        if found.gaps[k] >= needs[k] - ROUNDING:
            continue  # only a thicker link would touch it
        touch = _touch(problem, pose.name, pose.key, link_words(arm, first + k), found, k, 0.0, first + k)
        lacking = needs - found.gaps - found.error - pose.displacement_bounds(arm)[first:]
        yield replace(touch, proved=bool(np.max(lacking) > touching_overlap(arm)))


def _touched_by_tip(problem: Problem, gaps: Gaps, place: NamedTipGoal) -> Iterator[Finding]:
    """Yield a finding per obstacle that the tip touches wherever it is within the tolerances of its goal.

    If the goal has a direction, the whole last link is checked.
    """
    arm = problem.arm
    if arm.mount_length >= arm.length:
        return
    tip = place.goal.position
    allowance = place.tolerances.position
    what = "the tip"
    back = np.zeros_like(tip)
    if place.goal.direction is not None:
        visible = min(float(arm.lengths[-1]), arm.length - arm.mount_length)
        back = visible * place.goal.direction / np.linalg.norm(place.goal.direction)
        what = link_words(arm, arm.links - 1)
        # The last link may be shifted by the position tolerance and turned about the tip by the heading tolerance.
        allowance += visible * place.tolerances.heading
    body = np.stack((tip - back, tip))[None]
    need = arm.tip_radius + problem.workspace.clearance
    for found in gaps.touched(body, need):
        if found.gaps[0] + found.error + allowance - need < -touching_overlap(arm):
            if place.goal.look_at is not None:
                yield _touched_from_near(problem, place, found)
            else:
                yield _touch(problem, place.name, place.key, what, found, 0, allowance, arm.links - 1)


def _touched_from_near(problem: Problem, place: NamedTipGoal, found: ObstacleGap) -> Finding:
    """Return the finding of a place to look at from so near that the tip touches an obstacle, or deep inside one."""
    arm, most = problem.arm, place.tolerances.position
    touch = _touch(problem, place.name, place.key, "the place", found, 0, most, arm.links - 1)
    gap = float(found.gaps[0])
    if gap < (-ROUNDING if found.outside else -float(arm.radii[-1])):
        return replace(touch, reason=touch.reason.replace(f"{place.name} is in contact: ", ""))
    need = arm.tip_radius + problem.workspace.clearance
    reason = (
        f"{place.key}: the greatest goal.distance, {short_length(most)}, is less than the tip's radius and the "
        f"clearance, {short_length(need)}, and the place is on or near '{found.name}'"
    )
    return replace(touch, reason=reason)


def _touch(
    problem: Problem, name: str, key: str, what: str, found: ObstacleGap, k: int, allowance: float, link: int
) -> Finding:
    """Return the finding of one contact, with the radius and the clearance that would just avoid the contact.

    Args:
        problem: the problem.
        name: name of the pose.
        key: key of the pose in the problem file.
        what: text that names the part of the arm in contact.
        found: gaps to the obstacle.
        k: index of the segment in contact.
        allowance: amount by which tolerances may widen the gap [m].
        link: index of the link in contact.
    """
    radius = float(problem.arm.radii[link])
    clearance = problem.workspace.clearance
    gap = float(found.gaps[k])
    where = at(found.places[k])
    if found.outside and gap < 0.0:
        how = f"{what} is {short_length(-gap)} outside the '{found.name}' at {where}"
    elif gap < -radius:
        how = f"{what} is {short_length(-gap)} inside '{found.name}' at {where}"
    elif radius - gap > 0.0:
        how = f"{what} overlaps '{found.name}' by {short_length(radius - gap)} at {where}"
    else:
        # Rounding is not given as a length.
        near = short_length(gap - radius if gap - radius > ROUNDING else 0.0)
        how = f"{what} has a clearance of {near} to '{found.name}' at {where}, {short_length(clearance)} is required"
    bounds: dict[str, float] = {}
    if (thinnest := gap + allowance - clearance) > 0.0:
        bounds |= _thinner(problem.arm, link, thinnest)
    if (nearest := gap + allowance - radius) >= 0.0 and clearance > 0.0:
        bounds["workspace.clearance"] = nearest
    return Finding(
        "contact",
        f"{key}: {name} is in contact: {how}",
        key=key,
        place=point(found.places[k]),
        measured=radius + clearance - gap,
        allowed=allowance,
        obstacles=(found.name,),
        bounds=bounds,
    )


def _thinner(arm: Arm, link: int, radius: float) -> dict[str, float]:
    """Return by key the radius that a link may have at most [m], for links that taper that of the thickest; or none."""
    if radius <= ROUNDING:
        return {}
    if arm.proportions is None:
        return {"arm.radius": radius}
    section = section_at(arm, link)
    widest = float(np.max(arm.radii[section.first : section.end]))
    return {section.key("radius"): radius * widest / float(arm.radii[link])}


def _self_touched(arm: Arm, pose: NamedPose) -> Iterator[Finding]:
    """Yield a finding for the pair of non-adjacent links that overlap most in a pose, if any do."""
    i, j = arm.self_pairs
    if len(i) == 0:
        return
    points = arm.joint_positions_at(pose.q)
    distances = segment_distances(points[i], points[i + 1], points[j], points[j + 1])[2]
    k = int(np.argmin(distances - arm.radii[i] - arm.radii[j]))
    thick = float(arm.radii[i[k]] + arm.radii[j[k]])
    overlap = thick - float(distances[k])
    allowance = pose.displacement_bounds(arm)
    # In the plane, even links of zero thickness cannot pass through each other.
    crossing = arm.dimension == 2 and distances[k] <= ROUNDING
    if overlap <= ROUNDING and not crossing:
        return
    yield Finding(
        "contact",
        f"{pose.key}: {pose.name} is in contact: links {i[k] + 1} and {j[k] + 1} overlap by {short_length(overlap)}",
        proved=bool(
            (crossing and not allowance.any()) or overlap > allowance[i[k]] + allowance[j[k]] + touching_overlap(arm)
        ),
        key=pose.key,
        place=point(points[i[k]]),
        measured=overlap,
        allowed=0.0,
        bounds=_thinner(arm, int(j[k]), float(arm.radii[j[k]]) * float(distances[k]) / thick),
    )


def within_torque_limits(problem: Problem) -> Iterator[Finding]:
    """Yield a finding per required pose that a joint or section is too weak to hold; only for arms on a fixed base.

    That of a section is not proved: how its torque varies within the tolerances of the pose is not bounded.
    """
    torque = problem.limits.torque
    # A guide tube carries part of the load, so fed arms are not checked.
    if torque is None or problem.arm.base_axes:
        return
    arm = problem.arm
    model = InverseDynamics(arm, problem.simulation.gravity)
    for pose in named_poses(problem):
        # At rest, inverse dynamics gives the gravity load of every joint.
        angles = revolute_angles(arm, pose.q[arm.coordinates.bends])
        load = np.abs(drive_torques(arm, model(angles, np.zeros_like(angles), np.zeros_like(angles))))
        limit = drive_torque_limits(arm, torque)
        number = int(np.argmax(load / limit))
        if load[number] > limit[number]:
            drive = f"joint {number // 3 + 1} ({joint_names(arm)[number]})"
            if arm.sections is not None:
                drive = f"section {number // arm.bends_a_joint + 1} ({arm.sections.drive_names[number]})"
            elif arm.coupled is not None:
                drive = arm.coupled.drive_names[number]
            reason = (
                f"{pose.key}: {drive} needs {load[number]:.4g} N m to "
                f"hold the arm still at {pose.name}, but its torque limit is {limit[number]:.4g} N m"
            )
            proved = arm.drives is None and bool(np.any(load - _lighter(problem, pose) > torque))
            yield replace(overloaded(problem, reason, number, float(load[number])), proved=proved)


def _lighter(problem: Problem, pose: NamedPose) -> FloatArray:
    """Return bounds on the decrease of each revolute's load within a pose's tolerances, (3 * links,) [N m]."""
    arm = problem.arm
    allowance = pose.displacement_bounds(arm)
    weights = float(np.linalg.norm(problem.simulation.gravity)) * np.append(arm.masses, arm.payload)
    carried = np.cumsum(weights[::-1])[::-1][: arm.links]
    # Tolerances may move every weight beyond a joint towards the joint by the displacements of both.
    moved = np.append(allowance, allowance[-1])
    nearer = np.cumsum((weights * moved)[::-1])[::-1][: arm.links] + carried * allowance
    # In space, bends also tilt the joint's axes, which changes the load of a moment M by at most M times the angle.
    if arm.coordinates.bends_a_joint > 1:
        lever = arm.places_from_tip[:-1]
        nearer = nearer + carried * lever * pose.rotation_bounds(arm)
    return np.repeat(nearer, 3)


def overloaded(problem: Problem, reason: str, number: int, load: float) -> Finding:
    """Return the finding, not marked as a proof, that a joint is too weak to hold the arm in one pose.

    Args:
        problem: the problem.
        reason: text that states joint, pose, load and limit.
        number: index of the revolute joint, or of the drive of a section.
        load: torque that it needs [N m].
    """
    limits = problem.limits.torque
    limit = np.inf if limits is None else float(drive_torque_limits(problem.arm, limits)[number])
    share = load / limit
    return Finding(
        "torque",
        reason,
        proved=False,
        key="limits.torque",
        measured=load,
        allowed=limit,
        unit="N m",
        bounds={"limits.torque": share, "arm.link_mass": 1.0 / share},
    )
