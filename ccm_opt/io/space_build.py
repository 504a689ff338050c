"""From the validated tables of a problem file with ``space = 3`` to its parts; defaults are filled in here."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.io.build import (
    build_feed,
    build_limits,
    build_options,
    build_simulation,
    each_revolute,
    link_inertia,
    link_masses,
)
from ccm_opt.io.schema import (
    LimitsTable,
    PlacementTable,
    PlannerTable,
    RootTable,
    SimulationTable,
    SpaceArmTable,
    SpaceGoalTable,
    SpaceObstacleTable,
    SpacePoseTable,
    SpaceStartTable,
    SpaceWorkspaceTable,
    ToleranceTable,
    VerificationTable,
)
from ccm_opt.problem import Tolerances, VerificationOptions
from ccm_opt.problem.space_problem import SpaceGoal, SpaceJointPose, SpaceProblem, SpaceStop, SpaceTipGoal
from ccm_opt.robot.link_bodies import SPACE_ROD_RADIUS
from ccm_opt.robot.space_arm import SpaceArm
from ccm_opt.scene.bodies import Body, BoxBody, CapsuleBody, CylinderBody, MeshBody, RigidPlacement, SphereBody
from ccm_opt.scene.scene import SpaceObstacle, SpaceWorkspace


@dataclass(frozen=True)
class SpaceTables:
    """All tables of a problem file in space, validated.

    Attributes:
        obstacles: each with its place in the file.
        meshes: bodies of those that are meshes, by that place.
    """

    root: RootTable
    workspace: SpaceWorkspaceTable
    obstacles: tuple[tuple[int, SpaceObstacleTable], ...]
    meshes: Mapping[int, MeshBody]
    arm: SpaceArmTable
    limits: LimitsTable
    start: SpaceStartTable
    goals: tuple[SpaceGoalTable, ...]
    planner: PlannerTable
    simulation: SimulationTable
    tolerance: ToleranceTable
    verification: VerificationTable


def build_space_problem(tables: SpaceTables, source: str) -> SpaceProblem:
    """Assemble a problem from tables that have passed all checks."""
    arm = build_space_arm(tables.arm)
    *stops, last = tables.goals
    return SpaceProblem(
        name=tables.root.name,
        description=tables.root.description,
        workspace=build_space_workspace(tables.workspace, tables.obstacles, tables.meshes),
        arm=arm,
        limits=build_limits(tables.limits, arm.links),
        start=build_space_pose(tables.start, arm),
        goal=_goal(last, arm),
        tolerances=_tolerances(last),
        stops=tuple(SpaceStop(_goal(stop, arm), _tolerances(stop), stop.pause) for stop in stops),
        planner=build_options(tables.planner),
        simulation=build_simulation(tables.simulation),
        joint_error=tables.tolerance.joint_error_deg,
        verification=VerificationOptions(tables.verification.contact_tolerance),
        source=source,
        length_unit=tables.root.units,
    )


def build_space_workspace(
    table: SpaceWorkspaceTable,
    obstacles: Sequence[tuple[int, SpaceObstacleTable]],
    meshes: Mapping[int, MeshBody],
) -> SpaceWorkspace:
    """The room and its obstacles; an obstacle without a name is ``obstacle`` and its place in the file, from 1."""
    built = [
        SpaceObstacle(item.name or f"obstacle {number + 1}", meshes.get(number) or build_body(item))
        for number, item in obstacles
    ]
    bounds = None if table.bounds is None else np.array(table.bounds)
    return SpaceWorkspace(bounds, tuple(built), table.clearance)


def build_body(table: SpaceObstacleTable) -> Body:
    """A body that is no mesh; the table holds exactly one kind."""
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
    """Where a body stands and how it is turned."""
    if table is None:
        return RigidPlacement()
    position = np.array(table.position)
    if table.quaternion is not None:
        return RigidPlacement.of_quaternion(position, np.array(table.quaternion))
    return RigidPlacement.turned(position, np.array(table.rotation_deg or [0.0, 0.0, 0.0]))


def build_space_arm(table: SpaceArmTable) -> SpaceArm:
    """The arm; its links are solid cylinders unless the inertia is given."""
    masses = link_masses(table)
    axial, transverse = link_inertia(table, masses, SPACE_ROD_RADIUS * table.link_length)
    direction = np.array(table.base.direction)
    return SpaceArm(
        links=table.links,
        link_length=table.link_length,
        radius=table.radius,
        base=np.array(table.base.position),
        direction=direction,
        up=across(np.array(table.base.up), direction),
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


def across(up: FloatArray, direction: FloatArray) -> FloatArray:
    """What of a vector lies across a unit vector, as a unit vector, shape (3,)."""
    rest = up - (up @ direction) * direction
    # Once more, since what the first time leaves of the direction is rounding of the whole.
    rest = rest - (rest @ direction) * direction
    return np.asarray(rest / np.linalg.norm(rest))


def build_space_pose(table: SpacePoseTable, arm: SpaceArm) -> SpaceJointPose:
    """A pose of the whole arm; the table holds exactly one kind."""
    bends = np.zeros((arm.links, 2)) if table.joints_deg is None else np.array(table.joints_deg)
    return SpaceJointPose(bends, arm.base_range[0] if table.feed is None else table.feed)


def _goal(table: SpaceGoalTable, arm: SpaceArm) -> SpaceGoal:
    """A goal for the tip or for the whole arm."""
    if table.position is None:
        return build_space_pose(table, arm)
    direction = None if table.direction is None else np.array(table.direction)
    return SpaceTipGoal(np.array(table.position), direction, tuple(np.array(place) for place in table.via or ()))


def _tolerances(table: SpaceGoalTable) -> Tolerances:
    return Tolerances(table.position_tolerance, table.direction_tolerance_deg)
