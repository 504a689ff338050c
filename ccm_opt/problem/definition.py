"""One planning problem: what is known before a motion is sought."""

from collections.abc import Sequence
from dataclasses import dataclass, field

from ccm_opt.core.expected import expect
from ccm_opt.core.length_words import LengthUnit, long_length, words_in
from ccm_opt.errors import ProblemError
from ccm_opt.problem.defects import defects
from ccm_opt.problem.field_types import ImportedDrawing, wrong_types
from ccm_opt.problem.options import CONTACT_SHARE_OF_LENGTH, PlannerOptions, SimulationOptions, VerificationOptions
from ccm_opt.problem.poses import Goal, JointPose, Stop, Tolerances
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.coordinates import Limits
from ccm_opt.scene.workspace import Workspace

WANTED_SHARE_OF_LENGTH = 0.015
"""Room that plans keep unless the problem says otherwise, as a share of the arm's length."""
WANTED_SHARE_OF_RADIUS = 0.5
"""The same as a share of its radius; the lesser room counts."""


@dataclass(frozen=True, repr=False)
class Problem:
    """One planning problem, in the plane or in space as its arm and its workspace are.

    Attributes:
        name: also names the output folder.
        description: one line for people.
        workspace: room, obstacles, clearance.
        arm: the jointed arm.
        limits: bounds on joint speed, acceleration and torque.
        start: where the motion begins.
        goal: where it ends.
        tolerances: how near the goal counts.
        stops: goals on the way to the last, in order.
        planner: planner options.
        simulation: simulation options.
        joint_error: of every joint at any time, with which the motion has to touch nothing [rad]; 0 asks for none.
        verification: how strictly plans are judged.
        source: the text of the problem file, kept for the record; empty when built in Python.
        length_unit: in which people are told lengths, that of the problem file: ``m``, ``mm`` or ``in``. All values
            are in metres whatever it is.
        drawing: what became of the drawing that some obstacles are from; None where there was none.

    Raises:
        ProblemError: something in it is of another type or shape than it has to be, or out of bounds; all is named.
    """

    name: str
    workspace: Workspace
    arm: Arm
    limits: Limits
    start: JointPose
    goal: Goal
    description: str = ""
    tolerances: Tolerances = field(default_factory=Tolerances)
    stops: tuple[Stop, ...] = ()
    planner: PlannerOptions = field(default_factory=PlannerOptions)
    simulation: SimulationOptions = field(default_factory=SimulationOptions)
    joint_error: float = 0.0
    verification: VerificationOptions = field(default_factory=VerificationOptions)
    source: str = ""
    length_unit: LengthUnit = "m"
    drawing: ImportedDrawing | None = None

    @property
    def dimension(self) -> int:
        """Number of coordinates of a point: 2 in the plane, 3 in space."""
        return self.arm.dimension

    @property
    def via_reach(self) -> float:
        """How near the tip has to come to a place of ``goal.via`` to pass it [m]: it names a bore or a gap."""
        return max(self.tolerances.position, self.arm.link_length)

    @property
    def contact_tolerance(self) -> float:
        """Gap that may be missing before a motion is refused, rounding as a rule [m]."""
        asked = self.verification.contact_tolerance
        return CONTACT_SHARE_OF_LENGTH * self.arm.length if asked is None else asked

    @property
    def wanted_gap(self) -> float:
        """Room beyond radius and clearance that planning keeps where there is so much [m].

        The paper's planner knows no wanted gap, and so keeps none.
        """
        if self.planner.method != "nlp":
            return 0.0
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

    @property
    def goals(self) -> Sequence[Stop]:
        """All goals in order, the last one with no pause."""
        return (*self.stops, Stop(self.goal, self.tolerances))

    @staticmethod
    def expected(value: object) -> None:
        """Refuse what is no problem where one is expected.

        Raises:
            ProblemError: with what was given, and how a problem is had.
        """
        expect(value, Problem, "a ccm_opt.Problem", "ccm_opt.load_problem reads one from a file")

    def __post_init__(self) -> None:
        # What has the wrong type would only fail in some check of its values.
        found = tuple(wrong_types(self)) or tuple(defects(self))
        if found:
            raise ProblemError(f"problem '{self.name}' cannot be used:\n" + "\n".join(f"  {line}" for line in found))
