"""What is known of problems in space."""

from collections.abc import Iterator
from dataclasses import replace

from ccm_opt.diagnosis.in_space.checks_at_once import AT_ONCE_IN_SPACE, found_in_space
from ccm_opt.diagnosis.in_space.moved_space_goal import moved_space_goals
from ccm_opt.diagnosis.in_space.space_checks import failed_in_space
from ccm_opt.diagnosis.in_space.tight_in_space import tight_in_space
from ccm_opt.diagnosis.in_space.turned_direction import turned_direction
from ccm_opt.diagnosis.in_space.ways_in_space import closed_in_space
from ccm_opt.diagnosis.in_space.wider_space_room import wider_space_room
from ccm_opt.diagnosis.knowledge import Knowledge, heading_may_mend
from ccm_opt.diagnosis.parameters import WholeChange
from ccm_opt.diagnosis.unit_hints import unit_hints_in_space
from ccm_opt.errors import Finding
from ccm_opt.space.problem import SpaceProblem, SpaceTipGoal
from ccm_opt.space.scene.scene import ROOM_NAME


def _hopeless(problem: SpaceProblem) -> bool:
    at_once = found_in_space(problem, AT_ONCE_IN_SPACE)
    return any(finding.proved for finding in at_once) or closed_in_space(problem)


def _left_out(problem: SpaceProblem, findings: tuple[Finding, ...]) -> Iterator[WholeChange]:
    """The goal's direction, where all that is known to stand in the way may be due to it, and places on the way."""
    goal = problem.goal
    if not isinstance(goal, SpaceTipGoal):
        return
    # Where nothing is known to stand in the way, few links may not be able to turn where there is little room.
    if goal.direction is not None and all(heading_may_mend(finding) for finding in findings):
        yield WholeChange(
            "goal.direction left out",
            "goal.direction",
            None,
            lambda p: replace(p, goal=replace(p.goal, direction=None)),
            part=turned_direction,
        )
    if goal.via and not any(finding.proved for finding in findings):
        yield WholeChange("goal.via left out", "goal.via", None, lambda p: replace(p, goal=replace(p.goal, via=())))


IN_SPACE = Knowledge(
    failed_in_space,
    _hopeless,
    tight_in_space,
    wider_space_room,
    moved_space_goals,
    _left_out,
    unit_hints_in_space,
    ROOM_NAME,
)
"""Of arms in space."""
