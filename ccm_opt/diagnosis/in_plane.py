"""What is known of problems in the plane."""

from collections.abc import Iterator

from ccm_opt.diagnosis.checks import failed, hopeless
from ccm_opt.diagnosis.knowledge import Knowledge, heading_may_mend
from ccm_opt.diagnosis.moved_goal import moved_goals
from ccm_opt.diagnosis.parameters import WholeChange, without_heading
from ccm_opt.diagnosis.tightness import tight_places
from ccm_opt.diagnosis.unit_hints import unit_hints
from ccm_opt.diagnosis.wider_room import wider_room
from ccm_opt.errors import Finding
from ccm_opt.freespace.workspace import BOUNDARY_NAME
from ccm_opt.problem import Problem


def _left_out(problem: Problem, findings: tuple[Finding, ...]) -> Iterator[WholeChange]:
    """The heading, where all that stands in the way may be due to it."""
    heading = without_heading(problem)
    if heading is not None and findings and all(heading_may_mend(finding) for finding in findings):
        yield heading


IN_PLANE = Knowledge(failed, hopeless, tight_places, wider_room, moved_goals, _left_out, unit_hints, BOUNDARY_NAME)
"""Of arms in the plane."""
