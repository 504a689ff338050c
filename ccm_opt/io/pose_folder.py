"""Folders of poses and reach maps."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import numpy.typing as npt

from ccm_opt.io.arrays_npz import arrays_npz, curve_arrays
from ccm_opt.io.folder import POSE_ARRAYS, POSE_RECORD, REACH_RECORD, write_folder
from ccm_opt.io.problem_data import recorded_data
from ccm_opt.io.solution_json import pose_json
from ccm_opt.io.strict_json import strict_text
from ccm_opt.solution import ReachMap, StaticPose


def write_pose(found: StaticPose, out: Path, pictures: Mapping[str, bytes] | None = None) -> Path:
    """Write the folder of a pose.

    Args:
        found: the pose.
        out: the directory that holds the folder; it is made when it is not there.
        pictures: content of pictures by file name.

    Returns:
        The folder, ``out / <problem's name>``.

    Raises:
        ProblemError: when the folder cannot be written, or another folder is in its place.
    """
    files = {POSE_RECORD: pose_json(found).encode(), POSE_ARRAYS: arrays_npz(pose_arrays(found))}
    return write_folder(out / found.problem.name, {**files, **(pictures or {})}, POSE_RECORD)


def pose_arrays(found: StaticPose) -> dict[str, npt.NDArray[np.generic]]:
    """The arrays of a pose under the names of the file format; angles [rad], lengths [m]."""
    arrays = curve_arrays((found.pose.curve,))
    del arrays["segments_offsets"]  # there is one curve
    return {
        "bend_angles": found.bends,
        "link_headings": found.pose.headings,
        "joint_positions": found.joint_positions,
        **arrays,
    }


SCHEMA = 1
"""Version of the record's layout."""


def write_reach(found: ReachMap, out: Path, pictures: Mapping[str, bytes] | None = None) -> Path:
    """Write the folder of a map.

    Args:
        found: the map.
        out: the directory that holds the folder; it is made when it is not there.
        pictures: content of pictures by file name.

    Returns:
        The folder, ``out / <problem's name>``.

    Raises:
        ProblemError: when the folder cannot be written, or another folder is in its place.
    """
    files = {REACH_RECORD: reach_json(found).encode(), "reach.npz": arrays_npz(reach_arrays(found))}
    return write_folder(out / found.problem.name, {**files, **(pictures or {})}, REACH_RECORD)


def reach_json(found: ReachMap) -> str:
    """The record of a map: what was asked, and figures."""
    record: dict[str, object] = {
        "schema": SCHEMA,
        "problem": recorded_data(found.problem),
        "step": found.step,
        "headings": len(found.headings),
        "cells": found.reachable.size,
        "reached": int(found.reachable.sum()),
        "proved_out_of_reach": int(found.proved.sum()),
        "no_pose_found": int((~found.reachable & ~found.proved).sum()),
        "area": found.area,
        "gap_seen": found.seen,
        "timings": dict(found.timings),
    }
    return strict_text(record)


def reach_arrays(found: ReachMap) -> dict[str, npt.NDArray[np.generic]]:
    """The arrays of a map under the names of the file format; angles [rad], lengths [m]."""
    return {
        "x": found.x,
        "y": found.y,
        "reachable": found.reachable,
        "proved": found.proved,
        "gap": found.gap,
        "headings": found.headings,
        "taken": found.taken,
        "heading_ranges": found.heading_ranges,
    }
