"""Files of poses and reach maps in space."""

from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path

import numpy as np
import numpy.typing as npt

from ccm_opt.errors import Diagnosis
from ccm_opt.io.arrays_npz import arrays_npz
from ccm_opt.io.folder import POSE_ARRAYS, POSE_RECORD, REACH_RECORD, write_folder
from ccm_opt.io.solution_json import SCHEMA, answer_record
from ccm_opt.io.space_scene import kept_meshes, mesh_data, space_recorded_data
from ccm_opt.io.strict_json import strict_text
from ccm_opt.problem.space_problem import SpaceProblem
from ccm_opt.robot.space_configuration import SpaceConfiguration
from ccm_opt.solution.space_solution import SpaceReachMap, SpaceStaticPose


def write_space_pose(found: SpaceStaticPose, out: Path, pictures: Mapping[str, bytes] | None = None) -> Path:
    """Write the folder of a pose in space.

    Args:
        found: the pose.
        out: the directory that holds the folder; it is made when it is not there.
        pictures: content of pictures by file name.

    Returns:
        The folder, ``out / <problem's name>``.

    Raises:
        ProblemError: when the folder cannot be written, or another folder is in its place.
    """
    files = {POSE_RECORD: space_pose_json(found).encode(), POSE_ARRAYS: arrays_npz(space_pose_arrays(found))}
    files |= kept_meshes(found.problem)
    return write_folder(out / found.problem.name, {**files, **(pictures or {})}, POSE_RECORD)


def space_pose_json(found: SpaceStaticPose) -> str:
    """The record of a pose in space, with the keys of one in the plane where they mean something.

    Args:
        found: the pose.

    Returns:
        JSON text; numbers that are not finite stand as null.
    """
    record = pose_record_of(found.problem, "solved") | answer_record(found)
    record |= {
        "feed": found.feed,
        "goal": asdict(found.goal_errors),
        "curve": space_curve_record(found.curve),
        "meshes": mesh_data(found.problem),
    }
    return strict_text(record)


def space_pose_failure_json(
    problem: SpaceProblem, status: str, diagnosis: Diagnosis, timings: Mapping[str, float]
) -> str:
    """The record of a problem in space at whose goal no pose was found; arguments as for ``pose_failure_json``."""
    return strict_text(pose_record_of(problem, status) | {"timings": dict(timings), "diagnosis": asdict(diagnosis)})


def pose_record_of(problem: SpaceProblem, status: str) -> dict[str, object]:
    """What every record of a pose in space begins with."""
    return {"schema": SCHEMA, "status": status, "problem": space_recorded_data(problem)}


def space_curve_record(curve: SpaceConfiguration) -> dict[str, object]:
    """A curve in space with the length, knots and both curvatures of every segment."""
    return {
        "base": curve.base.tolist(),
        "base_frame": curve.base_frame.tolist(),
        "segments": [
            {"length": segment.length, "knots": list(segment.knots), "curvature": segment.curvature.tolist()}
            for segment in curve.segments
        ],
    }


def space_pose_arrays(found: SpaceStaticPose) -> dict[str, npt.NDArray[np.generic]]:
    """The arrays of a pose in space under the names of the file format; angles [rad], lengths [m]."""
    curve = found.curve
    arrays: dict[str, npt.NDArray[np.generic]] = {
        "bend_angles": found.bends,
        "joint_positions": found.joint_positions,
        "segment_lengths": np.array([segment.length for segment in curve.segments]),
        "segment_curvatures": np.array([segment.curvature for segment in curve.segments]),
        "segment_knots": np.array([segment.knots for segment in curve.segments]),
        "base_frame": curve.base_frame,
    }
    if found.problem.arm.base_axes:
        arrays["base_feed"] = np.array(found.feed)
    return arrays


def write_space_reach(found: SpaceReachMap, out: Path, pictures: Mapping[str, bytes] | None = None) -> Path:
    """Write the folder of a map in space; arguments, result and errors as for ``write_reach``."""
    files = {REACH_RECORD: space_reach_json(found).encode(), "reach.npz": arrays_npz(space_reach_arrays(found))}
    files |= kept_meshes(found.problem)
    return write_folder(out / found.problem.name, {**files, **(pictures or {})}, REACH_RECORD)


def space_reach_json(found: SpaceReachMap) -> str:
    """The record of a map in space: what was asked, and figures."""
    record: dict[str, object] = {
        "schema": SCHEMA,
        "problem": space_recorded_data(found.problem),
        "step": found.step,
        "directions": len(found.directions),
        "cells": found.reachable.size,
        "reached": int(found.reachable.sum()),
        "proved_out_of_reach": int(found.proved.sum()),
        "no_pose_found": int((~found.reachable & ~found.proved).sum()),
        "volume": found.volume,
        "gap_seen": found.seen,
        "meshes": mesh_data(found.problem),
        "timings": dict(found.timings),
    }
    return strict_text(record)


def space_reach_arrays(found: SpaceReachMap) -> dict[str, npt.NDArray[np.generic]]:
    """The arrays of a map in space under the names of the file format; lengths [m]."""
    return {
        "x": found.x,
        "y": found.y,
        "z": found.z,
        "reachable": found.reachable,
        "proved": found.proved,
        "gap": found.gap,
        "directions": found.directions,
        "taken": found.taken,
    }
