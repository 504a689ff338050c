"""What problems of arms in the plane and in space have in common: the gaps they are judged by, and their one line."""

from collections.abc import Sequence
from typing import Protocol

from ccm_opt.core.length_words import LengthUnit, long_length, words_in
from ccm_opt.problem.options import PlannerOptions, VerificationOptions
from ccm_opt.robot.arm import Arm

CONTACT_SHARE_OF_LENGTH = 1e-6
"""Contact tolerance unless the problem says otherwise, as a share of the arm's length: far below what machines are made
to, and above what the certificate and the chords between samples leave to rounding."""
MOST_CONTACT_SHARE_OF_LENGTH = 1e-3
"""Greatest contact tolerance, as such a share: with more of it a plan may go through what it has to keep clear of."""
WANTED_SHARE_OF_LENGTH = 0.015
"""Room that plans keep unless the problem says otherwise, as a share of the arm's length."""
WANTED_SHARE_OF_RADIUS = 0.5
"""The same as a share of its radius; the lesser room counts."""


class Room(Protocol):
    """What a problem tells of its workspace."""

    @property
    def obstacles(self) -> Sequence[object]:
        """Everything in it."""


class PlanningProblem:
    """What follows from the parts of a problem; the kinds of problems, frozen dataclasses, hold them.

    The attributes are those of ``Problem`` and ``SpaceProblem``.
    """

    name: str
    workspace: Room
    arm: Arm
    stops: Sequence[object]
    planner: PlannerOptions
    verification: VerificationOptions
    length_unit: LengthUnit

    @property
    def dimension(self) -> int:
        """Number of coordinates of a point: 2 in the plane, 3 in space."""
        return self.arm.dimension

    @property
    def contact_tolerance(self) -> float:
        """Gap that may be missing before a motion is refused, rounding as a rule [m]."""
        asked = self.verification.contact_tolerance
        return CONTACT_SHARE_OF_LENGTH * self.arm.length if asked is None else asked

    @property
    def wanted_gap(self) -> float:
        """Room beyond radius and clearance that planning keeps where there is so much [m]."""
        return self.default_gap if self.planner.wanted_gap is None else self.planner.wanted_gap

    @property
    def default_gap(self) -> float:
        """The wanted gap where the options name none, 1.5 % of the arm's length or half its radius [m].

        The lesser of the two, as much as one would leave beside a hose of that size. An arm without a radius gets the
        former.
        """
        share = WANTED_SHARE_OF_LENGTH * self.arm.length
        return share if self.arm.radius == 0.0 else min(share, WANTED_SHARE_OF_RADIUS * self.arm.radius)

    def __repr__(self) -> str:
        arm = self.arm
        goals = f", {len(self.stops) + 1} goals" if self.stops else ""
        room = f"{len(self.workspace.obstacles)} obstacles"
        with words_in(self.length_unit):
            length = long_length(arm.length)
        return f"<{type(self).__name__} '{self.name}': {arm.links} links, {length} long, {room}{goals}>"
