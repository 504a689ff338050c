"""Tables of limits, simulation, planner, tolerances and verification in a problem file."""

from typing import Annotated

from pydantic import Field

from ccm_opt.io.quantities import (
    DEGREES,
    RADIANS,
    NonNegative,
    NonNegativeLength,
    Positive,
    PositiveAcceleration,
    PositiveEach,
    PositiveJerk,
    PositiveLength,
    PositiveSpeed,
    Table,
    Vector,
    Weight,
)
from ccm_opt.problem import (
    ControllerName,
    Disturbances,
    MethodName,
    OptimiserName,
    OrderName,
    PlannerOptions,
    RetimingName,
    SimulationOptions,
    TourEnd,
    VerificationOptions,
    Weights,
)
from ccm_opt.robot.arm import MappingName


class PointLimitTable(Table):
    """Table of the limits on speed and acceleration of one point of the arm."""

    at: NonNegativeLength = Field(description="Arc length of the point from the base, along the links.")
    velocity: PositiveSpeed | None = Field(default=None, description="Limit on the point's speed. Default: none.")
    acceleration: PositiveAcceleration | None = Field(
        default=None, description="Limit on the point's acceleration. Default: none."
    )


class LimitsTable(Table):
    """Table of limits of joints (one value for all, per ball joint, or per revolute), feed axis, and points."""

    velocity: PositiveEach = Field(description="Joint velocity [rad/s].")
    acceleration: PositiveEach = Field(description="Joint acceleration [rad/s²].")
    jerk: PositiveEach | None = Field(
        default=None, description="Joint jerk [rad/s³]. Default: none, accelerations may jump."
    )
    torque: PositiveEach | None = Field(default=None, description="Joint torque [N m]. Default: none.")
    feed_velocity: PositiveSpeed | None = Field(
        default=None, description="Velocity of the feed axis; required if there is one."
    )
    feed_acceleration: PositiveAcceleration | None = Field(
        default=None, description="Acceleration of the feed axis; required if there is one."
    )
    feed_jerk: PositiveJerk | None = Field(
        default=None, description="Jerk of the feed axis. Default: none, its acceleration may jump."
    )
    feed_force: Positive | None = Field(default=None, description="Force of the feed axis [N]. Default: none.")
    tip_velocity: PositiveSpeed | None = Field(
        default=None, description=("Speed of the tip, in any direction. Default: none.")
    )
    tip_acceleration: PositiveAcceleration | None = Field(
        default=None, description="Acceleration of the tip, in any direction. Default: none."
    )
    points: list[PointLimitTable] = Field(
        default=[],
        description="`[{ at = s, velocity = …, acceleration = … }, …]`: the same for other points of the arm.",
    )


class GainsTable(Table):
    """Table of the PD gains of every joint, proportional [N m/rad] and derivative [N m s/rad]; by default tuned."""

    proportional: Positive | None = Field(
        default=None, description="Proportional gain [N m/rad]. Default: tuned for the arm, or to the other gain."
    )
    derivative: Positive | None = Field(
        default=None, description="Derivative gain [N m s/rad]. Default: tuned for the arm, or to the other gain."
    )


class DisturbancesTable(Table):
    """Table of the differences between the simulated arm and the model that the controller uses."""

    mass_error: Annotated[float, Field(gt=-1.0)] = Field(
        default=Disturbances.mass_error,
        description="Relative error of the link masses: 0.1 makes the links 10 % heavier than modelled.",
    )
    payload: NonNegative = Field(default=Disturbances.payload, description="Mass at the tip that the model lacks [kg].")
    friction: NonNegative = Field(
        default=Disturbances.friction,
        description="Viscous friction of every revolute that the model lacks [N m s/rad].",
    )
    angle_noise_deg: Annotated[float, Field(ge=0.0), RADIANS, DEGREES] = Field(
        default=Disturbances.angle_noise,
        description=("Standard deviation of the measured angles [deg]; in the plane, of the bends only."),
    )
    velocity_noise: NonNegative = Field(
        default=Disturbances.velocity_noise,
        description="Standard deviation of the measured velocities [rad/s], likewise.",
    )
    start_delay: NonNegative = Field(
        default=Disturbances.start_delay,
        description="Time for which the brakes still hold the arm after the motion has begun [s].",
    )
    seed: Annotated[int, Field(ge=0)] = Field(default=Disturbances.seed, description="Seed of the noise.")


class SimulationTable(Table):
    """Table of the settings for simulating the timed motion under closed-loop control."""

    gravity: Vector = Field(
        default_factory=SimulationOptions().gravity.tolist,
        description="Gravity in 3-D [m/s²]; the plane of planar arms is (x, z).",
    )
    step: Positive = Field(default=SimulationOptions.step, description="Integration step [s].")
    controller: ControllerName = Field(default=SimulationOptions.controller, description="Control law.")
    bandwidth: Positive = Field(
        default=SimulationOptions.bandwidth,
        description=(
            "Natural frequency for which both control laws are tuned, at the joints and on the feed axis [1/s]."
        ),
    )
    gains: GainsTable = Field(
        default=GainsTable(),
        description=(
            "Gains of the PD law at every joint: `{ proportional = …, derivative = … }` [N m/rad, N m s/rad]. "
            "Default: [tuned for the arm](dynamics.md#the-closed-loop) at this bandwidth."
        ),
    )
    disturbances: DisturbancesTable = Field(
        default=DisturbancesTable(),
        description="How the simulated arm differs from the controller's model ([below](#simulation-disturbances)).",
    )


class WeightsTable(Table):
    """Table of the weights of the costs that planning minimises."""

    path_length: Weight = Field(default=Weights.path_length, description="Joint travel along the motion.")
    smoothness: Weight = Field(
        default=Weights.smoothness, description="Changes of the joint steps from keyframe to keyframe."
    )
    bending: Weight = Field(default=Weights.bending, description="Curvature of the arm.")
    clearance: Weight = Field(
        default=Weights.clearance,
        description=(
            "Proximity to walls that are nearer than 3 % of the arm's length. With 0, motions run close to "
            "`workspace.clearance`, which is kept in any case."
        ),
    )
    duration: Weight = Field(
        default=Weights.duration,
        description=(
            "Steps and changes of steps of each joint, relative to its velocity and acceleration limit: a "
            "proxy for the duration, useful where joints have different limits."
        ),
    )


class PlannerTable(Table):
    """Table of the choice of planner, its time limit and its options."""

    method: MethodName = Field(
        default=PlannerOptions.method,
        description=(
            'Planner: `"nlp"`, that of this package, or `"hill-climbing"`, [that of the '
            "paper](the-paper-claim-by-claim.md)."
        ),
    )
    mapping: MappingName = Field(
        default=PlannerOptions.mapping,
        description='Mapping from a curve to joints; `"even-joints"` is that of the paper.',
    )
    time_limit: Positive = Field(
        default=PlannerOptions.time_limit,
        description=(
            "CPU time after which the search stops [s]; CPU time, so that the result does not depend "
            "on the load of the machine. Three times as much wall time ends it too."
        ),
    )
    routes: Annotated[int, Field(ge=1)] = Field(
        default=PlannerOptions.routes,
        description="Number of corridors tried, shortest first; in the plane only.",
    )
    seed: Annotated[int, Field(ge=0)] = Field(
        default=PlannerOptions.seed,
        description=(
            "Seed of the order of candidates, of the sampled goal poses and of the trees; 0 tries the most "
            "promising candidate first. The same seed gives the same plan."
        ),
    )
    tries: Annotated[int, Field(ge=1)] = Field(
        default=PlannerOptions.tries,
        description=(
            "Number of plans made, with `seed` and the seeds after it, each with an equal share of the remaining "
            "time. The fastest is taken of those whose least gap is at least 0.9 of the largest. With "
            "`hill-climbing`, which samples nothing, only 1 is accepted."
        ),
    )
    optimiser: OptimiserName = Field(
        default=PlannerOptions.optimiser,
        description='Optimisation of the motion over all keyframes; `"none"` keeps the motion as it was found.',
    )
    retiming: RetimingName = Field(
        default=PlannerOptions.retiming,
        description=(
            'How the path is timed: `"toppra"`, as fast as the limits allow; or `"paul"`, as in the paper: constant '
            "velocity between keyframes with smooth transitions at them. The transitions leave the "
            "certified path a little; they are shortened until the verifier accepts the motion."
        ),
    )
    wanted_gap: NonNegativeLength | None = Field(
        default=PlannerOptions.wanted_gap,
        description=(
            "Preferred clearance, beyond radius and `workspace.clearance`, of [the goal "
            "pose](how-a-motion-is-found.md) and the motion; a passage that allows less gets as much as it allows. "
            "With 0, only `workspace.clearance` is kept. What the motion keeps is [in its record](clearance.md), and "
            "`solve --pareto` shows what other values cost. Planar motions that follow a leader on a feed axis keep "
            "the clearance of its path; `hill-climbing` ignores it. Default: 1.5 % of the arm's length or half "
            "its radius, whichever is less."
        ),
    )
    effort_share: Annotated[float, Field(gt=0.0, le=1.0)] = Field(
        default=PlannerOptions.effort_share,
        description=(
            "Fraction of the drives' limits (velocity, acceleration, jerk, torque, and those of the feed axis) "
            "that plans use; the rest is reserved for [the "
            "controller](dynamics.md#what-a-plan-leaves-to-the-controller). Limits on the tip and on other "
            "points are used in full."
        ),
    )
    follow_within: PositiveLength | None = Field(
        default=PlannerOptions.follow_within,
        description=(
            "Most that an arm on a feed axis may leave [the path of its tip](arms.md#how-well-the-arm-follows): a hard "
            "limit on every plan, which the verifier checks. Only together with `arm.feed`. Default: no bound."
        ),
    )
    order: OrderName = Field(
        default=PlannerOptions.order,
        description=(
            'Order of several goals: `"given"`, or `"free"`, the one that takes least time '
            "([how](#goals-in-free-order)); goals that are not reached are then left out."
        ),
    )
    end: TourEnd = Field(
        default=PlannerOptions.end,
        description=(
            'Where a motion to goals in free order ends: at any goal (`"free"`), at the last one of the file '
            '(`"last"`), or back at the start (`"start"`).'
        ),
    )
    weights: WeightsTable = Field(
        default=WeightsTable(), description="Weights of the costs ([below](#planner-weights))."
    )


class ToleranceTable(Table):
    """Table of the joint errors under which the motion must remain collision-free."""

    joint_error_deg: Annotated[float, Field(ge=0.0, lt=180.0), RADIANS, DEGREES] = Field(
        default=0.0,
        description=(
            "Joint error that the motion must tolerate: with every joint off by up to this angle, independently and "
            "at all times, the clearance is still kept. 0: not required."
        ),
    )


class VerificationTable(Table):
    """Table of the settings that determine how strictly plans are verified."""

    contact_tolerance: PositiveLength | None = Field(
        default=VerificationOptions.contact_tolerance,
        description=(
            "Shortfall of the clearance up to which a motion is accepted, at most a thousandth of the "
            "arm's length; motions "
            "that start or end in contact may use half of it. It covers rounding; safety distances belong in "
            "`workspace.clearance`. Default: [a millionth of the arm's length](guarantees.md)."
        ),
    )
