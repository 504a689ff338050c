"""Construction of a planning problem from the validated tables of a problem file, with defaults filled in."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import shapely

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import ProblemError
from ccm_opt.io.build_arm import build_arm, build_limits, with_axis_limits
from ccm_opt.io.goal_tables import GoalTable, PoseTable, SpaceGoalTable, SpacePoseTable
from ccm_opt.io.option_tables import PlannerTable, SimulationTable
from ccm_opt.io.scene_tables import ObstacleTable, SpaceObstacleTable, SpaceWorkspaceTable, WorkspaceTable
from ccm_opt.io.shape_tables import PlacementTable
from ccm_opt.problem import (
    Coverage,
    Disturbances,
    Goal,
    JointPose,
    LookAt,
    PlannerOptions,
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
from ccm_opt.scene.bodies import Body, BoxBody, CapsuleBody, CylinderBody, MeshBody, RigidPlacement, SphereBody
from ccm_opt.scene.workspace import Obstacle, PlaneShape, Workspace

_BENDS_ROUNDING = math.radians(0.05)
"""Largest difference of given bends from those of drives that is attributed to digits left out [rad]."""
_FOLDED_SHARE = 0.95
"""Fraction of the joint limit that a folded arm uses, so that its joints can still move in both directions.
Heuristic."""
_GAP_IN_DIAMETERS = 1.1
"""Minimum distance between the axes of links of a folded arm that are checked for self-collision, in link diameters."""
_LEAST_GAP_IN_LINKS = 0.1
"""Minimum distance between the axes of links of a folded arm that are checked for self-collision, in link lengths;
applies to arms of very small or zero radius."""


def folded_bends(arm: Arm) -> FloatArray:
    """Return the joint angles of the most compact serpentine of an arm, shape (n links,) [rad].

    A serpentine consists of equal straight runs of links joined by half turns, alternately to the left and to the
    right. The first run lies along the base heading. A half turn of m joints bends each joint by π / m and places the
    runs l cot(π / 2m) apart, with l the link length. Candidates differ in m and in the number of links per run. They
    respect the joint limit, and keep links apart that are checked for self-collision. The one whose bounding box has
    the shortest diagonal is returned.

    Args:
        arm: a planar arm.

    Returns:
        Bend angles of the joints, shape (n,) [rad].

    Raises:
        ProblemError: the links are unequal, or no serpentine respects the joint limit and the radius.
    """
    if arm.proportions is not None:
        raise ProblemError("an arm of unequal links is not folded; give the pose by joints_deg")
    gap = max(_GAP_IN_DIAMETERS * 2.0 * arm.radius, _LEAST_GAP_IN_LINKS * arm.link_length)
    candidates = sorted(_serpentines(arm, _FOLDED_SHARE), key=lambda bends: _diagonal(arm, bends))
    for bends in candidates:
        if self_distance(arm, bends) >= gap:
            return bends
    raise ProblemError(
        f"an arm of {arm.links} links with a joint limit of {math.degrees(arm.joint_limit):g}° cannot fold "
        "by half a turn; use more links or a larger arm.joint_limit_deg, or give the pose by joints_deg"
    )


def self_distance(arm: Arm, bends: FloatArray) -> float:
    """Return the minimum distance between the axes of any two links that are checked for self-collision [m].

    Args:
        arm: a planar arm; its ``distant_pairs`` are the pairs of links that are compared.
        bends: bend angles of the joints, shape (n links,) [rad].

    Returns:
        The distance; infinite if the arm has no such pair.
    """
    points = arm.joint_positions(arm.headings(bends))
    axes = np.asarray(shapely.linestrings(np.stack((points[:-1], points[1:]), axis=1)))
    first, second = arm.distant_pairs
    return float(shapely.distance(axes[first], axes[second]).min(initial=np.inf))


def _serpentines(arm: Arm, limit_share: float) -> Iterator[FloatArray]:
    """Yield the joint angles of candidate serpentines, for all numbers of joints per half turn and per straight run.

    Args:
        arm: a planar arm of n links.
        limit_share: fraction of the joint limit that half turns may use.

    Yields:
        Bend angles of the joints, shape (n,) [rad].
    """
    sharpest = limit_share * arm.joint_limit
    fewest = max(2, math.ceil(min(math.pi / sharpest, arm.links)))
    # Rows of a thick arm must be two radii apart, which takes half turns of about π r / l joints.
    for_thickness = math.ceil(math.pi * arm.radius / arm.link_length)
    most = min(fewest + 6 + for_thickness, arm.links - 1)
    for turn in range(fewest, most + 1):
        # The bounding box is square for rows of about 0.8 √(turn · links); much longer rows cannot be the most compact.
        rows = max(1, min(arm.links - turn, 2 * math.isqrt(turn * arm.links) + 2))
        for row in range(rows):
            yield _serpentine(arm.links, turn, row)


def _serpentine(links: int, turn: int, row: int) -> FloatArray:
    """Return the joint angles of straight runs joined by half turns, alternately left and right, shape (n,) [rad].

    Args:
        links: number n of links.
        turn: number of joints per half turn.
        row: number of joints at zero angle between two half turns.
    """
    left = np.concatenate((np.zeros(row), np.full(turn, math.pi / turn)))
    period = np.concatenate((left, -left))
    bends = np.resize(period, links - 1)
    return np.concatenate(([0.0], bends))


def _diagonal(arm: Arm, bends: FloatArray) -> float:
    return float(np.linalg.norm(np.ptp(arm.joint_positions(arm.headings(bends)), axis=0)))


def build_problem(tables: Mapping[str, Any], source: str) -> Problem:
    """Return the planning problem that the validated tables of a problem file describe.

    Args:
        tables: tables by name, which have passed all checks of ``table_reading``.
        source: text of the problem file.
    """
    arm = build_arm(tables["arm"])
    mapping = tables["planner"].mapping
    workspace = build_workspace(tables["workspace"], tables["obstacles"], tables["meshes"])
    coverage = build_coverage(tables["goals"][0])
    if coverage is None:
        *stops, last = ((_goal(goal, arm, mapping), _tolerances(goal), goal.pause) for goal in tables["goals"])
    else:
        stops, last = [], (TipGoal.seeing(coverage, workspace), Tolerances(), tables["goals"][0].pause)
    simulation: SimulationTable = tables["simulation"]
    return Problem(
        name=tables["root"].name,
        description=tables["root"].description,
        workspace=workspace,
        arm=arm,
        limits=with_axis_limits(build_limits(tables["limits"], arm), tables["arm"]),
        start=build_pose(tables["start"], arm, mapping),
        goal=last[0],
        tolerances=last[1],
        stops=tuple(Stop(*stop) for stop in stops),
        pause=last[2],
        planner=build_options(tables["planner"]),
        simulation=SimulationOptions(
            gravity=np.array(simulation.gravity),
            step=simulation.step,
            controller=simulation.controller,
            bandwidth=simulation.bandwidth,
            proportional_gain=simulation.gains.proportional,
            derivative_gain=simulation.gains.derivative,
            disturbances=Disturbances(**simulation.disturbances.values),
        ),
        joint_error=tables["tolerance"].joint_error_deg,
        verification=VerificationOptions(**tables["verification"].values),
        source=source,
        length_unit=tables["root"].units,
        coverage=coverage,
    )


def build_workspace(
    table: WorkspaceTable | SpaceWorkspaceTable,
    obstacles: Sequence[tuple[int, ObstacleTable | SpaceObstacleTable]],
    meshes: Mapping[int, MeshBody | PlaneShape] | None = None,
) -> Workspace:
    """Return the workspace, planar or in space, that the tables of a problem file describe.

    Args:
        table: the table ``[workspace]``.
        obstacles: index in the file, from 0, and table of each obstacle; an obstacle without a name is called
            ``obstacle`` and its number from 1.
        meshes: shapes of the obstacles that are read from files, by index in the file.
    """
    named = [(number, item.name or f"obstacle {number + 1}", item) for number, item in obstacles]
    if isinstance(table, SpaceWorkspaceTable):
        bounds = None if table.bounds is None else np.array(table.bounds)
        bodies = tuple(
            Obstacle(name, (meshes or {}).get(number) or _body(item))
            for number, name, item in named
            if isinstance(item, SpaceObstacleTable)
        )
        return Workspace(bounds=bounds, obstacles=bodies, clearance=table.clearance)
    shapes = tuple(
        Obstacle(name, (meshes or {}).get(number) or _shape(item))
        for number, name, item in named
        if isinstance(item, ObstacleTable)
    )
    return Workspace(build_boundary(table), shapes, table.clearance)


def build_boundary(table: WorkspaceTable) -> shapely.Polygon:
    """Return the boundary of a planar workspace as a polygon [m]."""
    return _box(table.bounds) if table.bounds is not None else shapely.Polygon(table.boundary)


def _shape(table: ObstacleTable) -> PlaneShape:
    """Return a planar obstacle from its table, which has exactly one kind of shape and needs no file."""
    if table.circle is not None:
        return PlaneShape(shapely.Point(table.circle.center), table.circle.radius)
    if table.wall is not None:
        return PlaneShape(shapely.LineString(table.wall.points), table.wall.thickness / 2.0)
    if table.box is not None:
        return PlaneShape(_box(table.box))
    if isinstance(table.points, list):
        return PlaneShape(shapely.MultiPoint(table.points), (table.point_radius or 0.0) + (table.error or 0.0))
    return PlaneShape(shapely.Polygon(table.polygon, table.holes))


def _box(corners: Sequence[float]) -> shapely.Polygon:
    xmin, ymin, xmax, ymax = corners
    return shapely.box(xmin, ymin, xmax, ymax)


def _body(table: SpaceObstacleTable) -> Body:
    """Return an obstacle in space other than a mesh as a solid, from its table, which has exactly one kind of shape."""
    placement = build_placement(table.pose)
    if table.sphere is not None:
        return SphereBody(placement.points(np.array(table.sphere.center)), table.sphere.radius)
    bar = table.cylinder or table.capsule
    if bar is not None:
        kind = CapsuleBody if table.cylinder is None else CylinderBody
        return kind(placement.points(np.array(bar.start)), placement.points(np.array(bar.end)), bar.radius)
    low, high = np.array(table.box)
    return BoxBody(low, high, placement)


def build_placement(table: PlacementTable | None) -> RigidPlacement:
    """Return the position and rotation of a solid from its table ``pose``; the identity if there is none."""
    if table is None:
        return RigidPlacement()
    position = np.array(table.position)
    if table.quaternion is not None:
        return RigidPlacement.of_quaternion(position, np.array(table.quaternion))
    return RigidPlacement.turned(position, np.array(table.rotation_deg or [0.0, 0.0, 0.0]))


def build_pose(table: PoseTable | SpacePoseTable, arm: Arm, mapping: MappingName) -> JointPose:
    """Return a pose of the whole arm from its table, which gives joint angles, the name of a pose, or curve segments.

    Args:
        table: the validated table ``[start]`` or ``[goal]``.
        arm: the arm.
        mapping: method that fits the joints to a curve of segments.

    Raises:
        ProblemError: the arm cannot be folded, or its joints cannot follow the curve.
    """
    feed = pose_feed(table, arm)
    shape = (arm.links, 2)[: arm.dimension - 1]
    given = None if table.joints_deg is None else np.array(table.joints_deg)
    if given is not None and arm.sections is not None and len(given) == len(arm.sections.counts):
        given = (arm.sections.coupling @ given.ravel()).reshape(shape)
    elif given is not None and arm.drives is not None and len(given) == arm.links:
        given = arm.drives.nearest(given.ravel(), _BENDS_ROUNDING).reshape(shape)
    if arm.dimension == 3:
        return JointPose(np.zeros(shape) if given is None else given, feed)
    if table.segments is not None:
        curve = Configuration.chain(
            arm.base,
            arm.base_heading if table.heading_deg is None else table.heading_deg,
            [segment.length for segment in table.segments],
            [np.array(segment.curvature) for segment in table.segments],
            [(segment.knots[0], segment.knots[1], segment.knots[2]) for segment in table.segments],
        )
        return JointPose.along(arm, curve, mapping, float(feed))
    if given is not None:
        return JointPose(given, feed)
    return JointPose(folded_bends(arm) if table.shape == "folded" else np.zeros(arm.links), feed)


def pose_feed(table: PoseTable | SpacePoseTable, arm: Arm) -> FloatArray | float:
    """Return the feed (position of the base on its feed axis) of a pose [m]; by default the lower end of the axis.

    Where other axes carry the base, their positions are returned, shape (k,) [m, rad], by default those nearest to 0.
    """
    if arm.carrier:
        # Lists of a wrong length are reported elsewhere.
        if not isinstance(table, SpacePoseTable) or len(table.axes or ()) != len(arm.carrier):
            return np.array([min(max(0.0, axis.low), axis.high) for axis in arm.carrier])
        both = np.array(table.axes)
        return np.array([both[k, int(axis.revolute)] for k, axis in enumerate(arm.carrier)])
    return arm.base_range[0] if table.feed is None else table.feed


def _goal(table: GoalTable | SpaceGoalTable, arm: Arm, mapping: MappingName) -> Goal:
    """Return a goal for the tip or for the whole arm from the table ``[goal]``."""
    return replace(_unnamed_goal(table, arm, mapping), name=table.name or "")


def _unnamed_goal(table: GoalTable | SpaceGoalTable, arm: Arm, mapping: MappingName) -> Goal:
    if table.path is not None:
        path = np.array(table.path)
        return TipGoal(path[-1], path=path)
    if table.look_at is not None:
        return TipGoal.looking(_look_at(table))
    if table.position is None:
        return build_pose(table, arm, mapping)
    direction = None if table.direction is None else np.array(table.direction)
    via = tuple(np.array(place) for place in table.via or ())
    up = None if table.up is None else np.array(table.up)
    return TipGoal(np.array(table.position), direction, via, table.heading_deg, up=up)


def _look_at(table: GoalTable | SpaceGoalTable) -> LookAt:
    """Return what the arm looks at, from the table ``[goal]``."""
    # The rules between keys make sure that these are given with a place to look at.
    distance, field = table.distance or [0.0, 0.0], table.field_of_view_deg or 0.0
    normal = None if table.normal is None else np.array(table.normal)
    angle = {} if table.angle_deg is None else {"angle": table.angle_deg}
    return LookAt(np.array(table.look_at), (distance[0], distance[1]), field, normal, **angle)


def build_coverage(table: GoalTable | SpaceGoalTable) -> Coverage | None:
    """Return the surfaces that have to be seen, from the table ``[goal]``; None if it is another goal."""
    if table.see is None:
        return None
    # The rules between keys make sure that these are given with surfaces to see.
    distance, field = table.distance or [0.0, 0.0], table.field_of_view_deg or 0.0
    angle = {} if table.angle_deg is None else {"angle": table.angle_deg}
    within = None if table.within is None else np.reshape(table.within, (2, -1))
    share, spacing = table.share or 0.0, table.spacing or 0.0
    return Coverage(tuple(table.see), share, spacing, (distance[0], distance[1]), field, within=within, **angle)


def _tolerances(table: GoalTable | SpaceGoalTable) -> Tolerances:
    """Return the position and angle tolerances of the table ``[goal]``."""
    if table.look_at is not None:
        return _look_at(table).tolerances
    turn = table.heading_tolerance_deg or table.direction_tolerance_deg
    return Tolerances(table.position_tolerance, turn, table.roll_tolerance_deg)


def build_options(table: PlannerTable) -> PlannerOptions:
    """Return the planner options that the table ``[planner]`` describes."""
    return PlannerOptions(**table.values | {"weights": Weights(**table.weights.values)})
