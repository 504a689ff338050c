"""Builds a planar problem from checked tables."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import shapely

from ccm_opt.core.arrays import FloatArray
from ccm_opt.errors import ProblemError
from ccm_opt.io.schema import (
    ArmTable,
    ChainTable,
    DisturbancesTable,
    FeedTable,
    GoalTable,
    LimitsTable,
    ObstacleTable,
    PlannerTable,
    PoseTable,
    RootTable,
    SegmentTable,
    SimulationTable,
    StartTable,
    ToleranceTable,
    VerificationTable,
    WorkspaceTable,
)
from ccm_opt.io.settings import FOLD, FoldSettings
from ccm_opt.problem import (
    Disturbances,
    Goal,
    JointPose,
    Limits,
    PlannerOptions,
    PointLimit,
    Problem,
    SimulationOptions,
    Stop,
    TipGoal,
    Tolerances,
    VerificationOptions,
    Weights,
)
from ccm_opt.robot.arm import Arm, MappingName
from ccm_opt.robot.configuration import Configuration
from ccm_opt.robot.link_bodies import DEFAULT_LINK_MASS, cylinder_inertia
from ccm_opt.robot.link_chain import Feed
from ccm_opt.scene.workspace import Obstacle, Workspace

_GAP_IN_DIAMETERS = 1.1
"""The axes of distant links keep at least this many link diameters (two radii) apart."""
_LEAST_GAP_IN_LINKS = 0.1
"""And at least this many link lengths, for arms of zero radius."""


def straight_bends(arm: Arm) -> FloatArray:
    """All links along the base heading, shape (links,) [rad]."""
    return np.zeros(arm.links)


def folded_bends(arm: Arm, settings: FoldSettings = FOLD) -> FloatArray:
    """The most compact serpentine: equal rows joined by half turns, alternately left and right.

    A half turn of m joints bends each by pi / m and sets the rows l cot(pi / 2m) apart. Of all (m, row length) whose
    bends stay within a share of the joint limit and whose distant links keep their gap, the one with the smallest
    diagonal of its bounding box is taken. The first row lies along the base heading, the first turn is to the left.

    Args:
        arm: the arm.
        settings: share of the joint limit, and gap.

    Returns:
        Joint bends, shape (links,) [rad].

    Raises:
        ProblemError: when no serpentine fits the joint limit and the radius.
    """
    gap = max(_GAP_IN_DIAMETERS * 2.0 * arm.radius, _LEAST_GAP_IN_LINKS * arm.link_length)
    candidates = sorted(_serpentines(arm, settings.limit_share), key=lambda bends: _diagonal(arm, bends))
    for bends in candidates:
        if self_distance(arm, bends) >= gap:
            return bends
    raise ProblemError(
        f"an arm of {arm.links} links with a joint limit of {math.degrees(arm.joint_limit):g} deg cannot be folded: "
        "half a turn needs more links; give the pose by joints_deg instead"
    )


def self_distance(arm: Arm, bends: FloatArray) -> float:
    """Least distance between the axes of links far enough apart along the arm [m]; infinite without such links."""
    points = arm.joint_positions(arm.headings(bends))
    axes = np.asarray(shapely.linestrings(np.stack((points[:-1], points[1:]), axis=1)))
    first, second = arm.distant_pairs
    return float(shapely.distance(axes[first], axes[second]).min(initial=np.inf))


def _serpentines(arm: Arm, limit_share: float) -> Iterator[FloatArray]:
    """Serpentines by joints a turn and straight joints a row; at least one whole half turn."""
    sharpest = limit_share * arm.joint_limit
    fewest = max(2, math.ceil(min(math.pi / sharpest, arm.links)))
    # Rows of a thick arm lie two radii apart, which takes turns of about π r / l joints.
    for_thickness = math.ceil(math.pi * arm.radius / arm.link_length)
    most = min(fewest + 6 + for_thickness, arm.links - 1)
    for turn in range(fewest, most + 1):
        # The box is square for rows of about 0.8 √(turn · links); much longer ones have no smallest diagonal.
        rows = max(1, min(arm.links - turn, 2 * math.isqrt(turn * arm.links) + 2))
        for row in range(rows):
            yield _serpentine(arm.links, turn, row)


def _serpentine(links: int, turn: int, row: int) -> FloatArray:
    """Rows of ``row`` straight joints and half turns of ``turn`` joints, alternately left and right."""
    left = np.concatenate((np.zeros(row), np.full(turn, math.pi / turn)))
    period = np.concatenate((left, -left))
    bends = np.resize(period, links - 1)
    return np.concatenate(([0.0], bends))


def _diagonal(arm: Arm, bends: FloatArray) -> float:
    return float(np.linalg.norm(np.ptp(arm.joint_positions(arm.headings(bends)), axis=0)))


@dataclass(frozen=True)
class Tables:
    """All tables of a problem file, validated."""

    root: RootTable
    workspace: WorkspaceTable
    obstacles: tuple[ObstacleTable, ...]
    arm: ArmTable
    limits: LimitsTable
    start: StartTable
    goals: tuple[GoalTable, ...]
    planner: PlannerTable
    simulation: SimulationTable
    tolerance: ToleranceTable
    verification: VerificationTable


def build_problem(tables: Tables, source: str) -> Problem:
    """Assemble a problem from tables that have passed all checks."""
    arm = build_arm(tables.arm)
    mapping = tables.planner.mapping
    *stops, last = tables.goals
    return Problem(
        name=tables.root.name,
        description=tables.root.description,
        workspace=build_workspace(tables.workspace, tables.obstacles),
        arm=arm,
        limits=build_limits(tables.limits, arm.links),
        start=build_pose(tables.start, arm, mapping),
        goal=build_goal(last, arm, mapping),
        tolerances=build_tolerances(last),
        stops=tuple(Stop(build_goal(stop, arm, mapping), build_tolerances(stop), stop.pause) for stop in stops),
        planner=build_options(tables.planner),
        simulation=build_simulation(tables.simulation),
        joint_error=tables.tolerance.joint_error_deg,
        verification=VerificationOptions(tables.verification.contact_tolerance),
        source=source,
        length_unit=tables.root.units,
    )


def build_workspace(table: WorkspaceTable, obstacles: Sequence[ObstacleTable]) -> Workspace:
    """The room and its obstacles; an obstacle without a name is ``obstacle`` and its place in the file, from 1."""
    boundary = _box(table.bounds) if table.bounds is not None else shapely.Polygon(table.boundary)
    named = tuple(build_obstacle(item, item.name or f"obstacle {k}") for k, item in enumerate(obstacles, start=1))
    return Workspace(boundary, named, table.clearance)


def build_obstacle(table: ObstacleTable, name: str) -> Obstacle:
    """One obstacle; the table holds exactly one kind."""
    if table.circle is not None:
        return Obstacle(name, shapely.Point(table.circle.center), table.circle.radius)
    if table.wall is not None:
        return Obstacle(name, shapely.LineString(table.wall.points), table.wall.thickness / 2.0)
    if table.box is not None:
        return Obstacle(name, _box(table.box))
    return Obstacle(name, shapely.Polygon(table.polygon, table.holes))


def _box(corners: Sequence[float]) -> shapely.Polygon:
    xmin, ymin, xmax, ymax = corners
    return shapely.box(xmin, ymin, xmax, ymax)


def build_arm(table: ArmTable) -> Arm:
    """The arm; its links are solid cylinders unless the inertia is given."""
    masses = link_masses(table)
    axial, transverse = link_inertia(table, masses)
    return Arm(
        links=table.links,
        link_length=table.link_length,
        radius=table.radius,
        base=np.array(table.base),
        base_heading=table.base_heading_deg,
        joint_limit=table.joint_limit_deg,
        base_limit=table.base_limit_deg,
        self_collision=table.self_collision,
        mount_length=table.radius if table.mount_length is None else table.mount_length,
        masses=masses,
        inertia_axial=axial,
        inertia_transverse=transverse,
        axes=table.axes,
        feed=None if table.feed is None else build_feed(table.feed),
        payload=table.payload,
        rotor_inertia=each_revolute(table.rotor_inertia, table.links),
        friction=each_revolute(table.friction, table.links),
    )


def link_masses(table: ChainTable) -> FloatArray:
    """One mass a link: from the list, else the same for all, shape (links,) [kg]."""
    if table.masses is not None:
        return _each(table.masses, table.links)
    return _each(DEFAULT_LINK_MASS if table.link_mass is None else table.link_mass, table.links)


def build_feed(table: FeedTable) -> Feed:
    """The feed axis; its guide tube ends where the base stands at full feed unless the file says otherwise."""
    low, high = table.range
    return Feed(low, high, high if table.hole is None else table.hole)


def link_inertia(table: ChainTable, masses: FloatArray, thinnest: float = 0.0) -> tuple[FloatArray, FloatArray]:
    """Given, or a solid cylinder's of the arm's radius, or of the thinnest that may stand for it [m]."""
    if table.inertia is not None:
        return _each(table.inertia.axial, table.links), _each(table.inertia.transverse, table.links)
    return cylinder_inertia(masses, max(table.radius, thinnest), table.link_length)


def build_limits(table: LimitsTable, links: int) -> Limits:
    """The limits of an arm of so many links."""
    return Limits(
        each_revolute(table.velocity, links),
        each_revolute(table.acceleration, links),
        None if table.torque is None else each_revolute(table.torque, links),
        table.feed_velocity,
        table.feed_acceleration,
        table.feed_force,
        None if table.jerk is None else each_revolute(table.jerk, links),
        table.feed_jerk,
        _point_limits(table),
    )


def _point_limits(table: LimitsTable) -> tuple[PointLimit, ...]:
    """The limits on the tip, if there are any, and on other points."""
    points = [PointLimit(point.at, point.velocity or np.inf, point.acceleration or np.inf) for point in table.points]
    if table.tip_velocity is None and table.tip_acceleration is None:
        return tuple(points)
    return (PointLimit(None, table.tip_velocity or np.inf, table.tip_acceleration or np.inf), *points)


def build_pose(table: PoseTable, arm: Arm, mapping: MappingName) -> JointPose:
    """A whole-arm pose; the table holds exactly one kind.

    Raises:
        ProblemError: the arm cannot be folded, or not be laid along the curve.
    """
    feed = feed_of(table, arm)
    if table.segments is not None:
        return JointPose.along(arm, _configuration(table.segments, table.heading_deg, arm), mapping, feed)
    if table.joints_deg is not None:
        return JointPose(np.array(table.joints_deg), feed)
    return JointPose(folded_bends(arm) if table.shape == "folded" else straight_bends(arm), feed)


def feed_of(table: PoseTable, arm: Arm) -> float:
    """Where the base is on its feed axis in a pose: as given, else at the least position of the range [m]."""
    return arm.base_range[0] if table.feed is None else table.feed


def build_goal(table: GoalTable, arm: Arm, mapping: MappingName) -> Goal:
    """A goal for the tip or for the whole arm."""
    if table.position is not None:
        return TipGoal(np.array(table.position), table.heading_deg)
    return build_pose(table, arm, mapping)


def build_tolerances(table: GoalTable) -> Tolerances:
    """How near the goal counts."""
    return Tolerances(table.position_tolerance, table.heading_tolerance_deg)


def _configuration(segments: Sequence[SegmentTable], heading: float | None, arm: Arm) -> Configuration:
    return Configuration.chain(
        arm.base,
        arm.base_heading if heading is None else heading,
        [segment.length for segment in segments],
        [np.array(segment.curvature) for segment in segments],
        [(segment.knots[0], segment.knots[1], segment.knots[2]) for segment in segments],
    )


def build_options(table: PlannerTable) -> PlannerOptions:
    """The planner's options."""
    values = table.model_dump()
    weights = Weights(**values.pop("weights"))
    return PlannerOptions(**values, weights=weights)


def build_simulation(table: SimulationTable) -> SimulationOptions:
    """How the motion is simulated."""
    return SimulationOptions(
        gravity=np.array(table.gravity),
        step=table.step,
        controller=table.controller,
        bandwidth=table.bandwidth,
        proportional_gain=table.gains.proportional,
        derivative_gain=table.gains.derivative,
        disturbances=_disturbances(table.disturbances),
    )


def _disturbances(table: DisturbancesTable) -> Disturbances:
    values = table.model_dump()
    return Disturbances(angle_noise=values.pop("angle_noise_deg"), **values)


def _each(value: float | Sequence[float], links: int) -> FloatArray:
    """One value a link, shape (links,)."""
    return np.broadcast_to(np.asarray(value, dtype=np.float64), (links,)).copy()


def each_revolute(value: float | Sequence[float], links: int) -> FloatArray:
    """One value a revolute, shape (3 * links,); a ball joint's value holds for its three."""
    values = np.asarray(value, dtype=np.float64)
    if values.shape == (links,):
        return np.repeat(values, 3)
    return np.broadcast_to(values, (3 * links,)).copy()
