"""The room that a verified plan keeps, and how much any motion could keep."""

from dataclasses import replace

from ccm_opt.diagnosis.possible_gap import possible_gap
from ccm_opt.driver.solve_settings import DEFAULT_SETTINGS, Settings
from ccm_opt.problem import Problem
from ccm_opt.solution import JointTrajectory, PossibleGap, RoomRecord
from ccm_opt.verification.room_over_time import room_over_time


def room_of(problem: Problem, trajectory: JointTrajectory, settings: Settings = DEFAULT_SETTINGS) -> RoomRecord:
    """The record of the room that a verified motion keeps.

    Args:
        problem: what was asked.
        trajectory: the motion.
        settings: of all stages.
    """
    room = room_over_time(problem, trajectory, problem.wanted_gap, settings.room, settings.verification)
    if room.wanted == 0.0:
        return room
    if not room.short:
        # What the motion keeps is possible, and more was not wanted.
        return replace(room, possible=PossibleGap(room.wanted, "wanted gap"))
    return replace(room, possible=possible_gap(problem, room, settings.diagnosis.passages))
