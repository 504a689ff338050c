"""Writers of the output folders of poses, reachability maps, failed runs, and Pareto-optimal plans."""

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
    """Write the output folder of a static pose: record, arrays, mesh files and pictures.

    Args:
        found: the pose.
        out: parent directory, created if missing.
        pictures: content of pictures by file name.

    Returns:
        The folder written, ``out / <name of the problem>``.

    Raises:
        ProblemError: the folder cannot be written, or a folder without a pose record is at this path.
    """
    files = {POSE_RECORD: pose_json(found).encode(), POSE_ARRAYS: arrays_npz(pose_arrays(found)), **(pictures or {})}
    return write_folder(out / found.problem.name, files | stored_meshes(found.problem), POSE_RECORD)


def pose_arrays(found: StaticPose) -> dict[str, npt.NDArray[np.generic]]:
    """Return the arrays of a static pose, by their names in ``pose.npz``; angles [rad], lengths [m]."""
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
    """Write the output folder of a reachability map; angles [rad], lengths [m].

    Arrays are named after the fields of the map. Arguments, return value and errors are those of ``write_pose``.
    """
    heading_keys = ("directions",) if found.problem.dimension == 3 else ("headings", "heading_ranges")
    arrays = dict(zip("xyz", found.axes, strict=False))
    arrays |= {name: getattr(found, name) for name in ("reachable", "proved", "gap", "taken", *heading_keys)}
    files = {REACH_RECORD: reach_json(found).encode(), "reach.npz": arrays_npz(arrays), **(pictures or {})}
    return write_folder(out / found.problem.name, files | stored_meshes(found.problem), REACH_RECORD)


def reach_json(found: ReachMap) -> str:
    """Return the record of a reachability map as JSON text: problem, counts of grid cells, area or volume, timings."""
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
        entries: dict[str, object] = {"directions": len(found.directions), "volume": found.size, "meshes": meshes}
    else:
        entries = {"headings": len(found.headings), "area": found.size}
    return strict_text(record | entries)


FAILED = ".failed"
"""Suffix of the folder of a failed run, used if the folder without suffix holds an earlier result to be kept."""
UNFINISHED = ".unfinished"
"""Suffix of the folder of a verified plan whose simulation or pictures were interrupted, used if the folder without
suffix holds an earlier result."""


def sibling_folder(target: Path, ending: str) -> Path:
    """Return ``target`` or, if that folder holds an earlier result, a folder next to it with a suffix.

    Args:
        target: path wanted for the output folder.
        ending: the suffix; a number is appended if the folder of that name holds a result too, or foreign files.

    Returns:
        A path that may be written: no folder exists there, or it holds only the record of a failed run.
    """
    if not holds_result(target):
        return target
    names = (f"{target.name}{ending}" + (f"-{number}" if number > 1 else "") for number in itertools.count(1))
    return next(place for name in names if _may_be_written(place := target.with_name(name)))


def holds_result(folder: Path) -> bool:
    """Return whether an output folder holds a plan or a pose, which the record of a failed run must not replace."""
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
    """Write the output folder of a problem for which no plan was found: ``solution.json``, meshes, and any pictures.

    Args:
        problem: the problem.
        status: how the search ended.
        diagnosis: reasons why no plan was found.
        out: parent directory, created if missing.
        timings: CPU time of each stage that ran, by stage name [s].
        pictures: content of pictures by file name.

    Returns:
        The folder written: ``out / <name of the problem>``, with suffix ``.failed`` if that folder holds a result.

    Raises:
        ProblemError: the folder cannot be written, or a folder without a record of a run is at this path.
    """
    record = failure_json(problem, status, diagnosis, timings or {})
    # Reading the problem in the record again requires its meshes.
    files = {RECORD: record.encode(), **stored_meshes(problem), **(pictures or {})}
    return write_folder(out / problem.name, files, beside=_FAILED_PLACE)


def write_pose_failure(
    problem: Problem, status: str, diagnosis: Diagnosis, out: Path, timings: Mapping[str, float]
) -> Path:
    """Write the output folder of a problem at whose goal no pose was found: ``pose.json`` and the mesh files.

    Args:
        problem: the problem.
        status: how the search ended.
        diagnosis: reasons why no pose was found.
        out: parent directory, created if missing.
        timings: CPU time of each stage that ran, by stage name [s].

    Returns:
        The folder written, with suffix ``.failed`` if the folder without suffix holds an earlier result.

    Raises:
        ProblemError: the folder cannot be written, or a folder without a pose record is at this path.
    """
    record = pose_failure_json(problem, status, diagnosis, timings)
    files = {POSE_RECORD: record.encode(), **stored_meshes(problem)}
    return write_folder(out / problem.name, files, POSE_RECORD, beside=_FAILED_PLACE)


_FAILED_PLACE = partial(sibling_folder, ending=FAILED)


def pareto_files(found: ParetoPlans) -> dict[str, bytes]:
    """Return the files of a set of Pareto-optimal plans, except the pictures, as a mapping from file name to content.

    The top level holds the recommended plan as ``solve`` would write it; the subfolder ``pareto`` holds every plan.
    Lengths in the record are in metres, times in seconds.
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
    """Return the subfolder of one Pareto-optimal plan within the output folder, given the plan's number from 1."""
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
