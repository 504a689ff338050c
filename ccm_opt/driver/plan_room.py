"""The room that a verified plan keeps, and how much any motion could keep."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from ccm_opt.diagnosis.possible_gap import possible_gap
from ccm_opt.diagnosis.walls_apart import gap_between_walls
from ccm_opt.driver.solve_settings import DEFAULT_SETTINGS, Settings
from ccm_opt.problem import Problem
from ccm_opt.solution import Check, JointTrajectory, PossibleGap, RoomRecord
from ccm_opt.verification.room_over_time import room_over_time


def room_of(
    problem: Problem,
    trajectory: JointTrajectory,
    checks: Sequence[Check],
    settings: Settings = DEFAULT_SETTINGS,
) -> RoomRecord:
    """The record of the room that a verified motion keeps.

    Args:
        problem: what was asked.
        trajectory: the motion.
        checks: of the verifier, which know its least gaps.
        settings: of all stages.
    """
    room = room_over_time(problem, trajectory, problem.wanted_gap, checks, settings.room, settings.verification)
    if room.wanted == 0.0:
        return room
    if not room.short:
        # What the motion keeps is possible, and more was not wanted.
        return replace(room, possible=PossibleGap(room.wanted, "wanted gap"))
    bounds = list(_bounds_of_passages(problem, trajectory, room))
    general = possible_gap(problem, room, settings.diagnosis.passages)
    if general is not None:
        bounds.append(general)
    return replace(room, possible=min(bounds, key=lambda bound: bound.value, default=None))


def _bounds_of_passages(problem: Problem, trajectory: JointTrajectory, room: RoomRecord) -> Iterator[PossibleGap]:
    """What the walls leave between which the arm stands where it misses most of the wanted gap on its way."""
    for part in room.short:
        if part.cause != "passage":
            continue
        pose = np.array([np.interp(part.nearest.time, trajectory.time, column) for column in trajectory.positions.T])
        bound = gap_between_walls(problem, problem.arm.joint_positions_at(pose), room.wanted)
        if bound is not None:
            yield bound
