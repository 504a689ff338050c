"""JSON records and NumPy archives of plans and static poses; the JSON is strict, without NaN or infinity."""

import math
import zipfile
from collections.abc import Iterable, Mapping
from dataclasses import asdict
from io import BytesIO
from types import MappingProxyType

import numpy as np
import numpy.typing as npt

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import Diagnosis
from ccm_opt.core.files import strict_text
from ccm_opt.io.problem_data import mesh_data, recorded_data, views_data
from ccm_opt.problem import Problem
from ccm_opt.problem.solution import (
    Check,
    ClearanceRecord,
    GoalErrors,
    GoalPoseRecord,
    NearPlace,
    Solution,
    StaticPose,
    ToleratedError,
    Tour,
)
from ccm_opt.problem.tool_rules import cover_notes
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.configuration import Configuration, Curve, SpaceConfiguration
from ccm_opt.robot.coordinates import Coordinates
from ccm_opt.robot.frames import drive_torques
from ccm_opt.robot.segment import segment_words
from ccm_opt.scene.tool_links import points_with_tool

SCHEMA = 1
"""Version of the layout of all JSON records."""
PARTIAL = "solved in part"
"""Status of a verified plan that leaves out goals in free order."""


def pose_json(found: StaticPose) -> str:
    """Return the record of a static pose as JSON text, with null for numbers that are not finite."""
    pose = found.pose
    variables, rows = pose.size
    record: dict[str, object] = {
        "schema": SCHEMA,
        "status": "solved",
        "problem": recorded_data(found.problem),
        "joints_deg": np.rad2deg(found.bends).tolist(),
        "joint_positions": found.joint_positions.tolist(),
        "gap": pose.gap,
        "wanted_gap": pose.wanted_gap,
        "nearest": found.nearest,
        "cost": pose.cost,
        "costs": dict(pose.costs),
        "multipliers": dict(pose.multipliers),
        "residuals": dict(found.residuals),
        "nlp": {"variables": variables, "rows": rows, "iterations": pose.iterations, "status": pose.status},
        "tries": [asdict(outcome) for outcome in found.outcomes],
        "timings": dict(found.timings),
    }
    if found.problem.dimension == 3:
        entries = {
            "feed": np.asarray(found.feed).tolist(),
            "goal": asdict(found.goal_errors),
            "curve": curve_record(found.curve),
        }
        return strict_text(record | entries | {"meshes": mesh_data(found.problem)})
    binding = [asdict(side) for side in found.binding]
    return strict_text(record | {"curve": curve_record(found.curve), "binding": binding})


def pose_failure_json(problem: Problem, status: str, diagnosis: Diagnosis, timings: Mapping[str, float]) -> str:
    """Return the record of a problem at whose goal no pose was found as JSON text.

    Args:
        problem: the problem.
        status: how the search ended.
        diagnosis: reasons why no pose was found.
        timings: CPU time of each stage that ran, by stage name [s].
    """
    record = {"schema": SCHEMA, "status": status, "problem": recorded_data(problem)}
    return strict_text(record | {"timings": dict(timings), "diagnosis": asdict(diagnosis)})


def curve_record(curve: Curve) -> dict[str, object]:
    """Return the record of a backbone curve: length, knots, curvature and, in the plane, type of each segment."""
    segments = [
        {"length": segment.length, "knots": list(segment.knots), "curvature": segment.curvature.tolist()}
        for segment in curve.segments
    ]
    if isinstance(curve, SpaceConfiguration):
        return {"base": curve.base.tolist(), "base_frame": curve.base_frame.tolist(), "segments": segments}
    if not isinstance(curve, Configuration):
        return {"segments": segments}
    typed = [{"type": segment_words(each)} | data for each, data in zip(curve.segments, segments, strict=True)]
    return {"base": curve.base.tolist(), "base_heading": curve.base_heading, "segments": typed}


def goal_pose_data(record: GoalPoseRecord) -> Mapping[str, object]:
    """Return the record of the goal configuration that was optimised before planning; lengths [m], angles [rad]."""
    variables, rows = record.size
    return {
        "reached": record.reached,
        "reason": record.reason,
        "configuration": record.configuration.tolist(),
        "curve": curve_record(record.curve),
        "gap": record.gap,
        "wanted_gap": record.wanted_gap,
        "cost": record.cost,
        "costs": dict(record.costs),
        "multipliers": dict(record.multipliers),
        "nlp": {"variables": variables, "rows": rows, "iterations": record.iterations, "status": record.status},
        "tried": record.tried,
    }


def clearance_data(room: ClearanceRecord) -> Mapping[str, object]:
    """Return the record of a motion's clearance [m, s], without the arrays over time, which are in ``solution.npz``."""
    possible = room.possible
    return {
        "wanted_gap": room.wanted,
        "clearance": room.clearance,
        "reach": room.reach,
        "nearest": place_data(room.nearest),
        "start": place_data(room.at_start),
        "stops": [place_data(end) for end in room.ends[1:-1]],
        "goal": place_data(room.at_goal),
        "short": [
            {"from": part.begin, "to": part.end, "cause": part.cause, "nearest": place_data(part.nearest)}
            for part in room.short
        ],
        "possible_gap": None if possible is None else possible.value,
        "possible_by": None if possible is None else possible.by,
        "possible_between": [] if possible is None else list(possible.walls),
        "limited_by": list(room.limited_by),
        "price": room.price,
    }


def place_data(place: NearPlace) -> Mapping[str, object]:
    """Return the record of where a link comes nearest to an obstacle or another link; lengths [m], times [s]."""
    other = {"second_link": place.second_link} if place.second_link else {"obstacle": place.obstacle}
    named = {"name": (place.name, place.link), "second_name": (place.second_name, place.second_link)}
    names = {key: name for key, (name, link) in named.items() if name not in {"", f"link {link}"}}
    near = {"link": place.link, **other, **names} if place.link else {}
    return {"gap": place.gap, "wanted": place.wanted, "time": place.time, **near}


def tolerance_data(errors: Iterable[ToleratedError]) -> list[Mapping[str, object]]:
    """Return one record for each error that a plan tolerates; angles are given in radians and in degrees."""
    return [asdict(e) | ({"size_deg": math.degrees(e.size)} if e.unit == "rad" else {}) for e in errors]


def tolerance_json(name: str, errors: Iterable[ToleratedError]) -> str:
    """Return the text of ``tolerance.json``: the maximum errors under which a plan remains collision-free.

    Args:
        name: name of the problem.
        errors: the maximum error of each kind that the plan tolerates.
    """
    return strict_text({"problem": name, "tolerance": tolerance_data(errors)})


def solution_json(solution: Solution) -> str:
    """Return the record of a verified plan as JSON text, with null for numbers that are not finite."""
    tour = solution.tour
    complete = tour is None or not tour.left_out
    posed = solution.problem if tour is None else tour.posed
    record = _record(posed, "solved" if complete else PARTIAL, solution.versions)
    record |= {
        "metrics": dict(solution.metrics),
        "timings": dict(solution.timings),
        "timed_by": list(solution.trajectory.timed_by),
        "checks": [_check_data(check) for check in solution.checks],
        "not_checked": list(solution.not_checked),
        "simulation": asdict(solution.simulation.verdict),
    }
    if solution.problem.dimension == 3:
        record["goal"] = goal_data(solution.goal_errors)
        record["meshes"] = mesh_data(solution.problem)
    if covers := cover_notes(solution.problem.arm):
        record["covers"] = covers
    if solution.room is not None:
        record["room"] = clearance_data(solution.room)
    if solution.tolerance:
        record["tolerance"] = tolerance_data(solution.tolerance)
    if tour is not None:
        record["tour"] = tour_data(tour)
    if solution.tries:
        record["tries"] = [asdict(each) for each in solution.tries]
    if solution.path.goal_pose is not None:
        record["goal_pose"] = goal_pose_data(solution.path.goal_pose)
    return strict_text(record)


def tour_data(tour: Tour) -> dict[str, object]:
    """Return the record of the order in which goals were visited, and of those left out; times [s]."""
    found = {
        "order": list(tour.order),
        "left_out": [asdict(goal) for goal in tour.left_out],
        "duration": tour.duration,
        "bound": tour.bound or None,
        "as_given": tour.as_given,
    }
    if tour.views:
        found |= {"views": views_data(tour), "fewest": tour.fewest, "unseen": list(tour.unseen)}
    return found


def goal_data(errors: GoalErrors) -> dict[str, object]:
    """Return the record of the deviation of the last link from its goal pose [m, rad]."""
    found: dict[str, object] = {
        "position_error": errors.position,
        "direction_error": errors.direction,
        "roll": errors.roll,
    }
    return found if errors.roll_error is None else found | {"roll_error": errors.roll_error}


def _check_data(check: Check) -> dict[str, object]:
    """Return the record of a verifier's check, without the place of minimum clearance, which is recorded elsewhere."""
    return {name: value for name, value in asdict(check).items() if name != "place"}


def failure_json(problem: Problem, status: str, diagnosis: Diagnosis, timings: Mapping[str, float]) -> str:
    """Return the record of a problem for which no plan was found as JSON text, with null for non-finite numbers.

    Args:
        problem: the problem.
        status: how the search ended.
        diagnosis: reasons why no plan was found.
        timings: CPU time of each stage that ran, by stage name [s].
    """
    record = _record(problem, status, {})
    record |= {"metrics": {}, "timings": dict(timings), "checks": [], "diagnosis": asdict(diagnosis)}
    return strict_text(record)


def _record(problem: Problem, status: str, versions: Mapping[str, str]) -> dict[str, object]:
    return {
        "schema": SCHEMA,
        "status": status,
        "method": problem.planner.method,
        "problem": recorded_data(problem),
        "versions": dict(versions),
        "seed": problem.planner.seed,
    }


_COMPRESSION = 1
"""Deflate level of arrays, from 1 (fast) to 9 (small). Measured on the plan of the example problem of a swan's neck,
1.37 MB uncompressed: 615 kB in 14 ms at level 1, 612 kB in 24 ms at level 6."""


def solution_arrays(solution: Solution) -> dict[str, npt.NDArray[np.generic]]:
    """Return the arrays of a plan, by their names in ``solution.npz``; angles [rad], lengths [m], time [s]."""
    trajectory, room = solution.trajectory, solution.room
    coordinates = trajectory.coordinates
    of_base = {
        "base_feed": trajectory.base_positions,
        "feed_velocities": trajectory.base_velocities,
        "feed_accelerations": trajectory.base_accelerations,
        "feed_forces": solution.joints.base_forces,
        "keyframe_feeds": solution.path.keyframes[:, coordinates.base],
    }
    simulated: dict[str, FloatArray] = {}
    if not solution.problem.arm.unsimulated:
        simulated = {
            "simulated_angles": solution.simulation.angles,
            "simulated_torques": solution.simulation.torques,
        }
        of_base["simulated_feed"] = solution.simulation.base_positions
    return {
        "time": trajectory.time,
        "bend_angles": by_joint(trajectory.bend_angles, coordinates),
        "joint_names": np.array(solution.joints.names),
        "joint_angles": solution.joints.angles,
        "joint_velocities": solution.joints.velocities,
        "joint_accelerations": solution.joints.accelerations,
        "joint_torques": solution.joints.torques,
        "joint_positions": solution.joint_positions,
        **_tool_tip(solution),
        "keyframes": by_joint(solution.path.keyframes[:, coordinates.bends], coordinates),
        **({} if solution.problem.dimension == 3 else curve_arrays(solution.path.curves)),
        **simulated,
        "stops": np.array(trajectory.stops, dtype=np.int64),
        # A fixed base has no columns here, and gaps are present only where they were measured.
        **_of_base(of_base, solution.problem.arm),
        **drive_arrays(solution.problem.arm, trajectory.bend_angles, solution.joints.torques),
        **({} if room is None else {"room_time": room.time, "wall_gaps": room.wall_gaps, "self_gaps": room.self_gaps}),
    }


def drive_arrays(arm: Arm, bends: FloatArray, torques: FloatArray) -> dict[str, npt.NDArray[np.generic]]:
    """Return the arrays of drives that move several joints together, by name; none for other arms.

    Args:
        arm: the arm.
        bends: bends of the joints, shape (T, 2 links) [rad].
        torques: torques of all revolutes, shape (T, 3 links) [N m].
    """
    coupled, sections = arm.drives, arm.sections
    if coupled is None:
        return {}
    drives, efforts = coupled.drives(bends), drive_torques(arm, torques)
    found = {
        "drive_values": drives,
        "drive_names": np.array(coupled.drive_names),
        "drive_torques": efforts,
    }
    if sections is None:
        return found
    return found | {
        "section_curvatures": sections.curvatures(drives),
        "section_azimuths": sections.azimuths(drives),
        "section_lengths": sections.lengths,
        "tendon_lengths": sections.tendon_lengths(drives),
        "tendon_tensions": sections.tendon_tensions(efforts),
    }


AXIS_NAMES: Mapping[str, str] = MappingProxyType(
    {
        "base_feed": "base_axes",
        "feed_velocities": "axis_velocities",
        "feed_accelerations": "axis_accelerations",
        "feed_forces": "axis_efforts",
        "keyframe_feeds": "keyframe_axes",
        "simulated_feed": "simulated_axes",
    }
)
"""Names of arrays of several base axes, with a column for each, by the names of those of a feed axis."""


def _of_base(columns: Mapping[str, FloatArray], arm: Arm) -> dict[str, FloatArray]:
    """Return the arrays of the axes that carry an arm, by name: one column of a feed axis, else all of them."""
    if arm.carrier:
        return {AXIS_NAMES[name]: values for name, values in columns.items()}
    return {name: column for name, values in columns.items() for column in values.T}


def _tool_tip(solution: Solution) -> dict[str, FloatArray]:
    """Return the positions of the tool's tip at the samples, shape (T, d) [m], by name; empty without a tool."""
    arm = solution.problem.arm
    return {} if arm.tool is None else {"tool_tip": points_with_tool(arm, solution.trajectory.positions)[:, -1]}


def by_joint(bends: FloatArray, coordinates: Coordinates) -> FloatArray:
    """Return joint angles in the layout of files: unchanged for a planar arm, shape (..., n links, 2) in space.

    Args:
        bends: bend angles of the joints, shape (..., n) in the plane, (..., 2 n) in space [rad].
        coordinates: layout of the arm's coordinates.
    """
    if coordinates.bends_a_joint == 1:
        return bends
    return bends.reshape(*bends.shape[:-1], -1, coordinates.bends_a_joint)


def arrays_npz(arrays: Mapping[str, npt.NDArray[np.generic]]) -> bytes:
    """Return the bytes of an ``.npz`` file; equal arrays give equal bytes at any time.

    Only arrays with columns of zeros are compressed. In a planar plan, two thirds of the revolute joints never move, so
    that their columns are zero.
    """
    buffer = BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        for name, array in arrays.items():
            idle = array.ndim == 2 and not np.all(np.any(array != 0, axis=0))
            entry = zipfile.ZipInfo(f"{name}.npy")  # with the fixed date 1980-01-01
            entry.compress_type = zipfile.ZIP_DEFLATED if idle else zipfile.ZIP_STORED
            content = BytesIO()
            np.lib.format.write_array(content, np.asanyarray(array), allow_pickle=False)
            archive.writestr(entry, content.getvalue(), compresslevel=_COMPRESSION if idle else None)
    return buffer.getvalue()


def bend_arrays(arrays: Mapping[str, npt.NDArray[np.generic]]) -> dict[str, npt.NDArray[np.generic]]:
    """Return the arrays of a plan without the revolute joints that never bend the arm.

    Each joint is modelled by three revolutes, of which one bends a planar arm and two bend an arm in space.

    Args:
        arrays: arrays of a plan, by name as in ``solution.npz``.
    """
    of_revolutes = {"joint_names"} | {f"joint_{what}" for what in ("angles", "velocities", "accelerations", "torques")}
    of_revolutes |= {"simulated_angles"} | ({"simulated_torques"} if "drive_names" not in arrays else set())
    kept = [1] if arrays["bend_angles"].ndim == 2 else [0, 1]
    columns = np.flatnonzero(np.isin(np.arange(len(arrays["joint_names"])) % 3, kept))
    return {name: array[..., columns] if name in of_revolutes else array for name, array in arrays.items()}


def curve_arrays(curves: tuple[Configuration, ...]) -> dict[str, npt.NDArray[np.generic]]:
    """Return backbone curves as arrays of their concatenated segments, by name as in ``solution.npz``.

    The segments of curve k run from ``segments_offsets[k]`` up to, but excluding, ``segments_offsets[k + 1]``.
    """
    segments = [segment for curve in curves for segment in curve.segments]
    return {
        "segments_offsets": np.cumsum([0, *(len(curve.segments) for curve in curves)]),
        "segment_lengths": np.array([segment.length for segment in segments], dtype=np.float64),
        "segment_curvatures": np.array([segment.curvature for segment in segments], dtype=np.float64).reshape(-1, 5),
        "segment_knots": np.array([segment.knots for segment in segments], dtype=np.float64).reshape(-1, 3),
        "base_headings": np.array([curve.base_heading for curve in curves], dtype=np.float64),
    }
