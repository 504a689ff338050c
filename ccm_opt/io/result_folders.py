"""Output folders of poses, reachability maps, failures, and Pareto plans."""

import itertools
from collections.abc import Mapping
from functools import partial
from pathlib import Path

import numpy as np
import numpy.typing as npt

from ccm_opt.core.errors import Diagnosis
from ccm_opt.core.files import strict_text
from ccm_opt.io.folder import (
    ARRAYS,
    PARETO_RECORD,
    POSE_ARRAYS,
    POSE_RECORD,
    REACH_RECORD,
    RECORD,
    solution_files,
    write_folder,
)
from ccm_opt.io.problem_data import mesh_data, recorded_data, stored_meshes
from ccm_opt.io.records import SCHEMA, arrays_npz, curve_arrays, failure_json, place_data, pose_failure_json, pose_json
from ccm_opt.problem import Problem
from ccm_opt.problem.solution import ParetoPlan, ParetoPlans, ReachMap, StaticPose
from ccm_opt.robot.configuration import Configuration, SpaceConfiguration


def write_pose(found: StaticPose, out: Path, pictures: Mapping[str, bytes] | None = None) -> Path:
    """Write the folder of a pose.

    Args:
        found: the pose.
        out: parent directory, created if missing.
        pictures: content of pictures by file name.

    Returns:
        The folder, ``out / <problem's name>``.

    Raises:
        ProblemError: the folder cannot be written, or a folder of something else is in its place.
    """
    files = {POSE_RECORD: pose_json(found).encode(), POSE_ARRAYS: arrays_npz(pose_arrays(found)), **(pictures or {})}
    return write_folder(out / found.problem.name, files | stored_meshes(found.problem), POSE_RECORD)


def pose_arrays(found: StaticPose) -> dict[str, npt.NDArray[np.generic]]:
    """Return the arrays of a pose by their names in the file format; angles [rad], lengths [m]."""
    arrays: dict[str, npt.NDArray[np.generic]] = {
        "bend_angles": found.bends,
        "joint_positions": found.joint_positions,
    }
    curve = found.curve
    if isinstance(curve, Configuration):
        curves = curve_arrays((curve,))
        del curves["segments_offsets"]  # needed only for several curves
        return arrays | {"link_headings": found.problem.arm.headings(found.bends)} | curves
    frame = {"base_frame": curve.base_frame} if isinstance(curve, SpaceConfiguration) else {}
    arrays |= {
        "segment_lengths": np.array([segment.length for segment in curve.segments]),
        "segment_curvatures": np.array([segment.curvature for segment in curve.segments]),
        "segment_knots": np.array([segment.knots for segment in curve.segments]),
        **frame,
    }
    if found.problem.arm.base_axes:
        arrays["base_feed"] = np.array(found.feed)
    return arrays


def write_reach(found: ReachMap, out: Path, pictures: Mapping[str, bytes] | None = None) -> Path:
    """Write the folder of a reachability map, with arrays named after its fields; angles [rad], lengths [m].

    Arguments, result and errors are those of ``write_pose``.
    """
    own = ("directions",) if found.problem.dimension == 3 else ("headings", "heading_ranges")
    arrays = dict(zip("xyz", found.axes, strict=False))
    arrays |= {name: getattr(found, name) for name in ("reachable", "proved", "gap", "taken", *own)}
    files = {REACH_RECORD: reach_json(found).encode(), "reach.npz": arrays_npz(arrays), **(pictures or {})}
    return write_folder(out / found.problem.name, files | stored_meshes(found.problem), REACH_RECORD)


def reach_json(found: ReachMap) -> str:
    """Return the record of a reachability map as JSON text: the problem, and figures."""
    record: dict[str, object] = {
        "schema": SCHEMA,
        "problem": recorded_data(found.problem),
        "step": found.step,
        "cells": found.reachable.size,
        "reached": int(found.reachable.sum()),
        "proved_out_of_reach": int(found.proved.sum()),
        "no_pose_found": int((~found.reachable & ~found.proved).sum()),
        "gap_seen": found.seen,
        "timings": dict(found.timings),
    }
    if found.problem.dimension == 3:
        meshes = mesh_data(found.problem)
        own: dict[str, object] = {"directions": len(found.directions), "volume": found.size, "meshes": meshes}
    else:
        own = {"headings": len(found.headings), "area": found.size}
    return strict_text(record | own)


FAILED = ".failed"
"""Suffix of the folder of a failure, where the folder itself holds an earlier result, which is kept."""
UNFINISHED = ".unfinished"
"""Suffix, likewise, for a verified plan whose simulation or pictures were interrupted."""


def sibling_folder(target: Path, ending: str) -> Path:
    """Return ``target`` itself or, where this folder holds an earlier result, a folder next to it with a suffix.

    Args:
        target: the folder of the result.
        ending: the suffix; a number follows where that folder also holds a result, or something that no run wrote.

    Returns:
        A folder that may be written: a new one, or one with the record of an earlier failure.
    """
    if not holds_result(target):
        return target
    names = (f"{target.name}{ending}" + (f"-{number}" if number > 1 else "") for number in itertools.count(1))
    return next(place for name in names if _may_be_written(place := target.with_name(name)))


def holds_result(folder: Path) -> bool:
    """Return whether a folder holds a plan or a pose, which a failure must not replace."""
    return any((folder / arrays).is_file() for arrays in (ARRAYS, POSE_ARRAYS))


def _may_be_written(place: Path) -> bool:
    if not place.exists():
        return not place.is_symlink()
    return place.is_dir() and any(place.glob("*.json")) and not holds_result(place)


def write_failure(
    problem: Problem,
    status: str,
    diagnosis: Diagnosis,
    out: Path,
    timings: Mapping[str, float] | None = None,
    pictures: Mapping[str, bytes] | None = None,
) -> Path:
    """Write the folder of a problem without a plan: ``solution.json``, and pictures where there are any.

    Args:
        problem: the problem.
        status: how the search ended.
        diagnosis: why there is no plan.
        out: parent directory.
        timings: CPU time of the stages that ran [s].
        pictures: content of pictures by file name.

    Returns:
        The folder ``out / <problem's name>``, with the suffix ``.failed`` where that folder holds an earlier plan.

    Raises:
        ProblemError: the folder cannot be written, or a folder of something else is in its place.
    """
    record = failure_json(problem, status, diagnosis, timings or {})
    # Reading the problem in the record again requires its meshes.
    files = {RECORD: record.encode(), **stored_meshes(problem), **(pictures or {})}
    return write_folder(out / problem.name, files, beside=_FAILED_PLACE)


def write_pose_failure(
    problem: Problem, status: str, diagnosis: Diagnosis, out: Path, timings: Mapping[str, float]
) -> Path:
    """Write the folder of a problem at whose goal no pose was found: ``pose.json``, in space with the meshes.

    Args:
        problem: the problem.
        status: how the search ended.
        diagnosis: why there is no pose.
        out: parent directory.
        timings: CPU time of the stages that ran [s].

    Returns:
        The folder, chosen as for ``write_failure``.

    Raises:
        ProblemError: the folder cannot be written, or a folder of something else is in its place.
    """
    record = pose_failure_json(problem, status, diagnosis, timings)
    files = {POSE_RECORD: record.encode(), **stored_meshes(problem)}
    return write_folder(out / problem.name, files, POSE_RECORD, beside=_FAILED_PLACE)


_FAILED_PLACE = partial(sibling_folder, ending=FAILED)


def pareto_files(found: ParetoPlans) -> dict[str, bytes]:
    """Return the content of every file of Pareto plans except the pictures, by file name.

    The folder itself holds the recommended plan, as ``solve`` would write it; all plans are in its subfolder
    ``pareto``. Lengths in the record are in metres, times in seconds.
    """
    files = solution_files(found.best)
    record = {
        "schema": SCHEMA,
        "problem": found.problem.name,
        "recommended": found.recommended,
        "most_time": found.most_time,
        "plans": [_plan_data(plan, number) for number, plan in enumerate(found.plans, start=1)],
    }
    files[PARETO_RECORD] = strict_text(record).encode()
    for number, plan in enumerate(found.plans, start=1):
        if plan.solution is not None:
            inner = solution_files(plan.solution)
            files |= {f"{folder_of(number)}/{name}": content for name, content in inner.items()}
    return files


def folder_of(number: int) -> str:
    """Return the subfolder of a plan, by its number from 1, within the problem's folder."""
    return f"pareto/{number}"


def _plan_data(plan: ParetoPlan, number: int) -> Mapping[str, object]:
    head = {"number": number, "wanted_gap": plan.wanted_gap}
    solution = plan.solution
    if solution is None or solution.room is None:
        return {**head, "status": "no plan", "reason": plan.reason}
    return {
        **head,
        "status": "solved",
        "folder": folder_of(number),
        "duration": plan.duration,
        "price": solution.room.price,
        "nearest": place_data(solution.room.nearest),
        "goal": place_data(solution.room.at_goal),
        "energy": plan.energy,
        "peak_torque": plan.peak_torque,
        "planning_cpu": plan.cpu,
        "simulation": solution.simulation.verdict.outcome,
        "dominated_by": plan.dominated_by or None,
    }
