"""One planning problem: what is known before a motion is sought."""

from dataclasses import dataclass, field

from ccm_opt.core.expected import expect
from ccm_opt.core.length_words import LengthUnit
from ccm_opt.errors import ProblemError
from ccm_opt.problem.defects import defects
from ccm_opt.problem.field_types import ImportedDrawing, wrong_types
from ccm_opt.problem.options import PlannerOptions, SimulationOptions, VerificationOptions
from ccm_opt.problem.planning_problem import PlanningProblem
from ccm_opt.problem.poses import Goal, JointPose, Stop, Tolerances
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.coordinates import Limits
from ccm_opt.scene.workspace import Workspace


@dataclass(frozen=True, repr=False)
class Problem(PlanningProblem):
    """One planning problem.

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
    def wanted_gap(self) -> float:
        """Room beyond radius and clearance that planning keeps where there is so much [m].

        The paper's planner knows no wanted gap, and so keeps none.
        """
        if self.planner.method != "nlp":
            return 0.0
        return super().wanted_gap

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
