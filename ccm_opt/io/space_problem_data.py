"""From a problem in space back to the data of a problem file: in its unit, angles in degrees."""

from collections.abc import Sequence

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.length_words import METRES, LengthUnit, in_unit
from ccm_opt.io.problem_data import (
    Table,
    chain_table,
    limits_table,
    planner_table,
    simulation_table,
    verification_table,
)
from ccm_opt.problem import Tolerances
from ccm_opt.problem.space_problem import SpaceGoal, SpaceJointPose, SpaceProblem, SpaceTipGoal
from ccm_opt.robot.space_arm import SpaceArm
from ccm_opt.scene.bodies import Body, BoxBody, CylinderBody, MeshBody, SphereBody
from ccm_opt.scene.rigid_placement import RigidPlacement


def space_problem_data(problem: SpaceProblem, mesh_files: Sequence[str]) -> Table:
    """Every value of a problem in space in the layout of ``problem.toml``.

    Angles pass through degrees, so that the problem read from these data may differ in the last bit.

    Args:
        problem: the problem.
        mesh_files: path of the mesh of each obstacle, relative to where the data will be read; of no matter where it is
            no mesh.

    Returns:
        Plain numbers, texts, lists and tables, from which ``problem_from_mapping`` rebuilds the problem.
    """
    unit = problem.length_unit
    return {
        "schema": 1,
        "space": 3,
        "name": problem.name,
        "description": problem.description,
        "units": unit,
        "workspace": _workspace(problem, mesh_files, unit),
        "arm": _arm(problem.arm, unit),
        "limits": limits_table(problem.limits, unit),
        "start": _pose(problem.start, problem.arm, unit),
        "goal": _goals(problem),
        "planner": planner_table(problem.planner, unit),
        "simulation": simulation_table(problem.simulation),
        "tolerance": {"joint_error_deg": float(np.rad2deg(problem.joint_error))},
        "verification": verification_table(problem.verification, unit),
    }


def _workspace(problem: SpaceProblem, mesh_files: Sequence[str], unit: LengthUnit) -> Table:
    workspace = problem.workspace
    table: Table = {"clearance": in_unit(workspace.clearance, unit)}
    if workspace.bounds is not None:
        table["bounds"] = [_lengths(corner, unit) for corner in workspace.bounds]
    table["obstacles"] = [
        {"name": each.name} | _body(each.body, file, unit)
        for each, file in zip(workspace.obstacles, mesh_files, strict=True)
    ]
    return table


def _body(body: Body, file: str, unit: LengthUnit) -> Table:
    """An obstacle without its name; bodies that are round stand where they are without being placed."""
    if isinstance(body, MeshBody):
        surface: Table = {} if body.solid else {"solid": False}
        if not body.content:
            # Made in Python: written in metres, where it stands.
            return {"mesh": file, "scale": 1.0 / METRES[unit]} | surface
        table: Table = {"mesh": file, "scale": body.scale / METRES[unit], "sha256": body.digest} | surface
        # Of GLB it is said that y is up where the key is not there.
        if body.up == "y" or body.file.lower().endswith(".glb"):
            table["up"] = body.up
        return table | _placement(body.placement, unit)
    if isinstance(body, BoxBody):
        return {"box": [_lengths(body.low, unit), _lengths(body.high, unit)]} | _placement(body.placement, unit)
    radius = in_unit(body.radius, unit)
    if isinstance(body, SphereBody):
        return {"sphere": {"center": _lengths(body.center, unit), "radius": radius}}
    bar = {"from": _lengths(body.start, unit), "to": _lengths(body.end, unit), "radius": radius}
    return {"cylinder" if isinstance(body, CylinderBody) else "capsule": bar}


def _placement(placement: RigidPlacement, unit: LengthUnit) -> Table:
    if placement.is_identity:
        return {}
    return {"pose": {"position": _lengths(placement.position, unit), "quaternion": placement.quaternion.tolist()}}


def _arm(arm: SpaceArm, unit: LengthUnit) -> Table:
    base = {"position": _lengths(arm.base, unit), "direction": arm.direction.tolist(), "up": arm.up.tolist()}
    return {**chain_table(arm, unit), "base": base}


def _goals(problem: SpaceProblem) -> Table | list[Table]:
    """The goal, or with stops on the way the list of all goals."""
    arm = problem.arm
    unit = problem.length_unit
    last = _goal(problem.goal, problem.tolerances, arm, unit)
    stops = [_goal(stop.goal, stop.tolerances, arm, unit) | {"pause": float(stop.pause)} for stop in problem.stops]
    return [*stops, last] if stops else last


def _goal(goal: SpaceGoal, tolerances: Tolerances, arm: SpaceArm, unit: LengthUnit) -> Table:
    near: Table = {
        "position_tolerance": in_unit(tolerances.position, unit),
        "direction_tolerance_deg": float(np.rad2deg(tolerances.heading)),
    }
    if not isinstance(goal, SpaceTipGoal):
        return _pose(goal, arm, unit) | near
    table: Table = {"position": _lengths(goal.position, unit)}
    if goal.direction is not None:
        table["direction"] = goal.direction.tolist()
    if goal.via:
        table["via"] = [_lengths(place, unit) for place in goal.via]
    return table | near


def _pose(pose: SpaceJointPose, arm: SpaceArm, unit: LengthUnit) -> Table:
    feed: Table = {axis: in_unit(pose.feed, unit) for axis in arm.coordinates.base_names}
    return {"joints_deg": np.rad2deg(pose.bends).tolist()} | feed


def _lengths(values: FloatArray, unit: LengthUnit) -> list[float]:
    """Lengths, or a place, in a unit."""
    return [in_unit(float(value), unit) for value in values]
