"""The room that a motion in space keeps, as far as its samples tell."""

import numpy as np

from ccm_opt.driver.space_look_settings import DEFAULT_SPACE_LOOKS, SpaceLookSettings
from ccm_opt.jointed.space_kinematics import joint_positions
from ccm_opt.solution import JointTrajectory, NearPlace, RoomRecord
from ccm_opt.space.problem import SpaceProblem
from ccm_opt.space.room_at_samples import GapsAtSamples


def room_in_space(
    problem: SpaceProblem, trajectory: JointTrajectory, settings: SpaceLookSettings = DEFAULT_SPACE_LOOKS
) -> RoomRecord:
    """The record of the room that a verified motion keeps.

    Args:
        problem: what was asked.
        trajectory: the motion.
        settings: at how many samples is looked, and how far.
    """
    rests = [0, *trajectory.stops, len(trajectory.time) - 1]
    even = np.linspace(0, len(trajectory.time) - 1, min(settings.looks, len(trajectory.time))).round().astype(np.intp)
    samples = np.union1d(even, rests)
    points = joint_positions(problem.arm, trajectory.positions[samples])
    # Far enough that the wanted gap, or the usual one, can be told from more.
    wanted = max(problem.wanted_gap, problem.default_gap)
    reach = max(problem.arm.link_length, settings.beyond_wanted * wanted) + problem.workspace.clearance
    gaps = GapsAtSamples.of(problem, points, reach)
    walls = gaps.walls.gap - problem.workspace.clearance
    itself = gaps.itself.gap

    def place(sample: int) -> NearPlace:
        near_wall = bool(walls[sample] <= itself[sample])
        near = gaps.walls if near_wall else gaps.itself
        link = int(near.link[sample])
        gap = float(min(walls[sample], itself[sample]))
        other = int(near.other[sample])
        obstacle = gaps.names[other] if near_wall and link else ""
        second = 0 if near_wall or not link else other
        return NearPlace(gap, problem.wanted_gap, float(trajectory.time[samples[sample]]), link, obstacle, second)

    ends = tuple(place(int(np.searchsorted(samples, rest))) for rest in rests)
    nearest = place(int(np.argmin(np.minimum(walls, itself))))
    time = trajectory.time[samples]
    return RoomRecord(time, problem.wanted_gap, problem.workspace.clearance, walls, itself, reach, nearest, ends)
