"""Checks of sections that bend evenly: that they do, and that the links contain the true arcs."""

import numpy as np

from ccm_opt.core.arrays import TINY, FloatArray
from ccm_opt.problem.solution import Check, JointTrajectory
from ccm_opt.robot.arm import Arm
from ccm_opt.verification.chain_motion import arc_turns

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
    bends = trajectory.positions[:, : 2 * arm.links].reshape(-1, arm.links, 2)
    turns = np.max(arc_turns(arm, trajectory.positions), axis=0)
    worst, where = float(np.max(np.abs(bends[:, 0]))), "joint 1, which does not bend"
    beyond, thin = -np.inf, ""
    first = 1
    for k, (count, length) in enumerate(zip(sections.counts.tolist(), sections.lengths.tolist(), strict=True)):
        own = bends[:, first : first + count]
        uneven = float(np.max(np.ptp(own, axis=1)))
        if uneven > worst:
            worst, where = uneven, f"section {k + 1}"
        beside = _beside_tangents(length / count, turns[first : first + count])
        taper = np.linspace(sections.radii[k, 0], sections.radii[k, 1], count + 1)
        # The arc about a joint lies along the ends of the two links that meet there.
        body = np.maximum(taper[:-1], taper[1:]) + beside
        for link in (0, -1):
            missing = body - arm.radii[first + link : first + link + count]
            if np.max(missing) > beyond:
                beyond = float(np.max(missing))
                thin = f"section {k + 1}, link {first + link + int(np.argmax(missing)) + 1}"
        first += count
    slack = _EVEN * arm.length
    return [
        Check("even bends of sections", worst, _EVEN, "rad", where, passed=bool(worst <= _EVEN)),
        Check("true arcs beyond links", max(beyond, 0.0), slack, "m", thin, passed=bool(beyond <= slack)),
    ]


def _beside_tangents(length: float, turns: FloatArray) -> FloatArray:
    """Return the distance of the middles of arcs of a length from their tangents, by their turns (n,), shape (n,) [m].

    The middle of an arc of the radius r and the turn θ is r (1 − cos θ / 2) from both tangents, farther than any other.
    """
    radius = length / np.maximum(turns, TINY)
    return np.asarray(np.where(turns > 0.0, radius * 2.0 * np.sin(0.25 * turns) ** 2, 0.0))
