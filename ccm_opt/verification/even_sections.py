"""Checks of joints that share drives.

Sections that bend evenly do so, and their links contain the true arcs; coupled joints turn by their ratios.
"""

import numpy as np

from ccm_opt.core.arrays import TINY, FloatArray
from ccm_opt.problem.solution import Check, JointTrajectory
from ccm_opt.robot.arm import Arm
from ccm_opt.verification.chain_motion import arc_turns, bend_pairs
from ccm_opt.verification.drives import section_joints
from ccm_opt.verification.limits import largest_magnitude, less_rounding
from ccm_opt.verification.verification_settings import VerificationSettings

_EVEN = 1e-9
"""Largest difference of the bends of a section's joints that is attributed to rounding [rad]."""


def check_even_sections(arm: Arm, trajectory: JointTrajectory) -> list[Check]:
    """Check that all joints of a section bend alike at the samples, and that links contain the body of the true arcs.

    Bends are linear in time between samples, so that sections bend evenly at all times, and turns are convex, so that
    the greatest are at samples. There are no checks for arms of other sections.

    Args:
        arm: the arm.
        trajectory: the motion.
    """
    sections = arm.sections
    if sections is None:
        return []
    bends = bend_pairs(arm, trajectory.positions)
    turns = np.max(arc_turns(arm, trajectory.positions), axis=0)
    joints = section_joints(sections)
    still = np.setdiff1d(np.arange(arm.links), np.concatenate(joints))
    worst, where = float(np.max(np.abs(bends[:, still]))), "joints that do not bend"
    beyond, thin = -np.inf, ""
    for k, own in enumerate(joints):
        count, length = len(own), float(sections.lengths[k])
        uneven = float(np.max(np.ptp(bends[:, own], axis=1)))
        if uneven > worst:
            worst, where = uneven, f"section {k + 1}"
        beside = _beside_tangents(length / count, turns[own])
        taper = np.linspace(sections.radii[k, 0], sections.radii[k, 1], count + 1)
        # The arc about a joint lies along the ends of the two links that meet there.
        body = np.maximum(taper[:-1], taper[1:]) + beside
        for link in (0, -1):
            missing = body - arm.radii[own + link]
            if np.max(missing) > beyond:
                beyond = float(np.max(missing))
                thin = f"section {k + 1}, link {own[int(np.argmax(missing))] + link + 1}"
    slack = _EVEN * arm.length
    return [
        Check("even bends of sections", worst, _EVEN, "rad", where, passed=bool(worst <= _EVEN)),
        Check("true arcs beyond links", max(beyond, 0.0), slack, "m", thin, passed=bool(beyond <= slack)),
    ]


def check_coupled_joints(arm: Arm, trajectory: JointTrajectory) -> list[Check]:
    """Check that joints that share a drive turn by its ratios; there are no checks for arms of other joints.

    The bend that a drive turns most gives the drive's value, and that the bends of the others. Both are linear in time
    between samples, so that samples suffice.

    Args:
        arm: the arm.
        trajectory: the motion.
    """
    if arm.coupled is None:
        return []
    ratios = arm.coupled.ratios
    bends = trajectory.positions[:, : 2 * arm.links]
    wanted = np.zeros_like(bends)
    for column in ratios.T:
        lead = int(np.argmax(np.abs(column)))
        wanted += bends[:, lead, None] / column[lead] * column
    off = np.abs(bends - wanted)
    k, bend = np.unravel_index(np.argmax(off), off.shape)
    worst = float(off[k, bend])
    where = f"joint {bend // 2 + 1} {'ab'[bend % 2]} at t = {trajectory.time[k]:.4f} s"
    return [Check("coupled joints", worst, _EVEN, "rad", where, passed=worst <= _EVEN)]


def check_tendons(arm: Arm, trajectory: JointTrajectory, settings: VerificationSettings) -> list[Check]:
    """Check travels and speeds of tendons that have limits; there are no checks for others.

    A tendon at the distance r and the angle γ about the axis is shortened by r (cos γ a − sin γ b) for the bends a and
    b of every section that it runs through; in the plane, where tendons are to its left and right, by ± r a. Bends are
    linear in time between samples, so that the greatest travel is at a sample, and the speed is constant in between.

    Args:
        arm: the arm.
        trajectory: the motion.
        settings: the tolerance of limits.
    """
    if arm.sections is None:
        return []
    columns = [trajectory.positions, trajectory.velocities]
    bends = (each[:, : (arm.dimension - 1) * arm.links].reshape(len(each), arm.links, -1) for each in columns)
    bent, rates = (each[:, 1:].cumsum(axis=1) for each in bends)
    ends = [joints[-1] - 1 for joints in section_joints(arm.sections)]
    time = trajectory.time
    checks = []
    moved: dict[str, list[tuple[float, float, str]]] = {"travel": [], "speed": []}
    for section, tendons in enumerate(arm.sections.tendons):
        if tendons is None:
            continue
        for number in range(tendons.number):
            angle = tendons.angle + 2.0 * np.pi * number / tendons.number
            side = tendons.radius * np.array([np.cos(angle), -np.sin(angle)])[: arm.dimension - 1]
            travel, speed = bent[:, ends[section]] @ side, rates[:, ends[section]] @ side
            steps = less_rounding(np.diff(travel) / np.diff(time), largest_magnitude(travel), np.diff(time))
            speeds = np.maximum(np.abs(speed), np.append(np.abs(steps), 0.0))
            for kind, values, limit in (("travel", np.abs(travel), tendons.travel), ("speed", speeds, tendons.speed)):
                if np.isfinite(limit):
                    k = int(np.argmax(values))
                    where = f"section {section + 1}, tendon {number + 1} at t = {time[k]:.4f} s"
                    moved[kind].append((float(values[k]), limit, where))
    for kind, found in moved.items():
        if found:
            worst, limit, where = max(found, key=lambda each: each[0] / each[1])
            unit = "m" if kind == "travel" else "m/s"
            passed = worst <= limit * (1.0 + settings.limit_tolerance)
            checks.append(Check(f"tendon {kind}", worst, limit, unit, where, passed=passed))
    return checks


def _beside_tangents(length: float, turns: FloatArray) -> FloatArray:
    """Return the distance of the middles of arcs of a length from their tangents, by their turns (n,), shape (n,) [m].

    The middle of an arc of the radius r and the turn θ is r (1 − cos θ / 2) from both tangents, farther than any other.
    """
    radius = length / np.maximum(turns, TINY)
    return np.asarray(np.where(turns > 0.0, radius * 2.0 * np.sin(0.25 * turns) ** 2, 0.0))
