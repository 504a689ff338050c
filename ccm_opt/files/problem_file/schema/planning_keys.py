"""Keys of the planner, of what a motion has to survive, and of the verifier."""

import math
from typing import Annotated

from pydantic import AfterValidator, Field

from ccm_opt.files.problem_file.schema.table import Table
from ccm_opt.files.problem_file.typed_quantities import NonNegativeLength, Positive, PositiveLength
from ccm_opt.jointed.arm import MappingName
from ccm_opt.problem import MethodName, OptimiserName, PlannerOptions, RetimingName, VerificationOptions, Weights

Weight = Annotated[float, Field(ge=0.0)]


class WeightsTable(Table):
    """How much each thing counts that planning makes small."""

    path_length: Weight = Weights.path_length
    """Turns of the joints along the motion."""
    smoothness: Weight = Weights.smoothness
    """Changes of these turns."""
    bending: Weight = Weights.bending
    """The arm's curvature."""
    clearance: Weight = Weights.clearance
    """Nearness to walls, where they are nearer than 3 % of the arm's length. At 0 motions run close to
    `workspace.clearance`; it is kept in any case."""
    duration: Weight = Weights.duration
    """Turns and changes of turns, each joint's against its own velocity and acceleration limit: a stand-in for the
    duration, of use where joints have different limits."""


class PlannerTable(Table):
    """Which planner, how long, and with what."""

    method: MethodName = PlannerOptions.method
    """`"nlp"`, this package's own planner, or `"hill-climbing"`, [the paper's](hill-climbing.md)."""
    mapping: MappingName = PlannerOptions.mapping
    """How a curve becomes joints; `"even-joints"` is the paper's."""
    time_limit: Positive = PlannerOptions.time_limit
    """CPU time of the process after which the search stops [s], so that what is found does not depend on what else the
    machine does. Three times as much wall time ends it too."""
    routes: Annotated[int, Field(ge=1)] = PlannerOptions.routes
    """Corridors tried, shortest first."""
    seed: Annotated[int, Field(ge=0)] = PlannerOptions.seed
    """Of the order in which candidates are tried, of the poses at the goal that are drawn, and of the trees; 0 tries
    the most promising candidate first. The same seed gives the same plan."""
    tries: Annotated[int, Field(ge=1)] = PlannerOptions.tries
    """So many plans are made, with `seed` and the seeds after it, each with an equal share of the time that is left; of
    those that keep nine tenths of the room that the roomiest keeps the shortest motion is taken. The paper's planner
    draws nothing, so more than one try is refused."""
    optimiser: OptimiserName = PlannerOptions.optimiser
    """How the motion is optimised over all keyframes; `"interior-point"` is the slow reference, by IPOPT."""
    retiming: RetimingName = PlannerOptions.retiming
    """How the path is timed: `"toppra"`, as fast as the limits allow; or `"paul"`, the paper's: joints move at constant
    speed between keyframes and turn smoothly at each. The second leaves the certified path a little, so shorter turns
    are tried until the verifier accepts the motion."""
    wanted_gap: NonNegativeLength | None = PlannerOptions.wanted_gap
    """Room beyond radius and clearance that [the goal pose](goal-pose.md) and the motion keep where there is so much;
    where a passage has less, as much as it has. 0: no more than the clearance is asked for. What the motion kept is [in
    its record](room.md), and `solve --pareto` shows what other gaps would cost. Motions that follow a leader on a feed
    axis keep the room of its path, and the paper's planner keeps none. Default: 1.5 % of the arm's length or half its
    radius, whichever is less."""
    effort_share: Annotated[float, Field(gt=0.0, le=1.0)] = PlannerOptions.effort_share
    """Share of the drives' limits (velocity, acceleration, jerk, torque, and those of the feed axis) that plans use;
    the rest is left to [the controller](dynamics.md#what-a-plan-leaves-to-the-controller). Limits on the tip and on
    other points are used in full."""
    weights: WeightsTable = WeightsTable()
    """What planning makes small ([below](#planner-weights))."""


class ToleranceTable(Table):
    """Errors with which the motion has to touch nothing."""

    joint_error_deg: Annotated[float, Field(ge=0.0, lt=180.0), AfterValidator(math.radians)] = 0.0
    """Error of every joint, at every time another, with which nothing may come nearer than the clearance; 0 asks for
    nothing."""


class VerificationTable(Table):
    """How strictly plans are judged."""

    contact_tolerance: PositiveLength | None = VerificationOptions.contact_tolerance
    """Gap that may be missing before a motion is refused; motions that begin or end in contact may use half of it. It
    is there for rounding, a thousandth of the arm's length at most: a clearance belongs into `workspace.clearance`.
    Default: [a millionth of the arm's length](scale.md)."""
