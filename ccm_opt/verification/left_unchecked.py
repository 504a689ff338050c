"""What no check looks at: links that are near along the arm, and the mount.

Axes of links i < j that meet close a polygon, whose turns are the bends between them and one more of at most half a
turn. A closed polygon turns by 2π at least (Fenchel), so that nothing is to be proved while these bends add up to less
than π in size. That is how it is almost always; the rest is proved like the distance of all other links.
"""

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.problem import Problem
from ccm_opt.robot.arm import Arm
from ccm_opt.solution import JointTrajectory
from ccm_opt.verification.consistency import distance_rounding
from ccm_opt.verification.link_motion import ChainMotion, Nodes
from ccm_opt.verification.selfcollision import first_distant, relative_travel, segment_distances
from ccm_opt.verification.stretch_proof import Nearest, Pairs, prove_apart
from ccm_opt.verification.verification_settings import DEFAULT_VERIFICATION, VerificationSettings
from ccm_opt.verification.wall_clearance import exposed_starts


def crossing_near_links(motion: ChainMotion, settings: VerificationSettings = DEFAULT_VERIFICATION) -> str:
    """Where two links cross that share no joint and are too near along the arm to be kept apart; empty if none do.

    Args:
        motion: of the arm.
        settings: with lengths in metres.

    Returns:
        The links and the time in words; where the proof is given up, that they may cross.
    """
    pairs = _bent_enough(motion, settings)
    if len(pairs) == 0:
        return ""

    lost = 2.0 * motion.rounding + distance_rounding(motion.size)

    def evaluate(nodes: Nodes, some: Pairs, poses: FloatArray) -> tuple[FloatArray, FloatArray]:
        k = some.node
        first = poses[k, some.link], poses[k, some.link + 1]
        second = poses[k, some.other], poses[k, some.other + 1]
        travel = nodes.half[k] * relative_travel(motion, nodes.interval[k], some.link, some.other)
        return segment_distances(*first, *second) - lost, travel

    verdict = prove_apart(motion, pairs, evaluate, settings.touch, Nearest(motion.arm.length), settings)
    if verdict.proved:
        return ""
    near = verdict.nearest
    does = "may cross" if verdict.remark else "crosses"
    return f"link {near.link + 1} {does} link {near.other + 1} at t = {near.time:.4f} s"


def _bent_enough(motion: ChainMotion, settings: VerificationSettings) -> Pairs:
    """Pairs of links, and the intervals in which the bends between them add up to half a turn at some time."""
    arm = motion.arm
    # Sizes of bends are convex in time between samples, so that they are greatest at one of these.
    total = np.concatenate((np.zeros((len(motion.time), 1)), np.cumsum(np.abs(motion.bends), axis=1)), axis=1)
    found = [np.zeros((3, 0), dtype=np.int64)]
    for apart in range(2, min(first_distant(arm), arm.links)):
        between = total[:, 1 + apart :] - total[:, 1:-apart]
        greatest = np.maximum(between[:-1], between[1:])
        node, link = np.nonzero(greatest >= np.pi - settings.half_turn_rounding)
        found.append(np.stack((node, link, link + apart)))
    return Pairs(*np.concatenate(found, axis=1))


def left_unchecked(
    problem: Problem, trajectory: JointTrajectory, settings: VerificationSettings = DEFAULT_VERIFICATION
) -> tuple[str, ...]:
    """What nothing was held against, though one might think so; none as a rule.

    Args:
        problem: what was asked.
        trajectory: the motion, which passes every check.
        settings: of the verifier.

    Returns:
        A clause each.
    """
    arm = problem.arm
    remarks = left_unchecked_of_arm(arm)
    if not arm.self_collision:
        return remarks
    motion = ChainMotion(arm, trajectory.time, trajectory.positions)
    crossing = crossing_near_links(motion, settings.for_problem(problem))
    if not crossing:
        return remarks
    return (*remarks, f"{crossing}: links less than {first_distant(arm)} apart along the arm are not kept apart")


def left_unchecked_of_arm(arm: Arm) -> tuple[str, ...]:
    """What follows from the arm alone, in the plane and in space: its mount, and links that are not kept apart.

    Returns:
        A clause each.
    """
    remarks = [_of_mount(arm)]
    if not arm.self_collision:
        remarks.append("links were not kept apart from each other, since arm.self_collision is false")
    elif first_distant(arm) >= arm.links:
        remarks.append("no links were kept apart from each other: all are near each other along the arm")
    return tuple(remark for remark in remarks if remark)


def _of_mount(arm: Arm) -> str:
    # Of a link that the mount covers but for rounding no more than its end is held against walls.
    whole = int((exposed_starts(arm) >= 1.0 - 1e-9).sum())
    if whole == arm.links:
        return "nothing was kept away from walls: the whole arm counts as its mount"
    return f"links 1 to {whole} were not kept away from walls: they belong to the mount" if whole else ""
