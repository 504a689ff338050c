"""The folder of a map of reach, written whole or not at all."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import numpy.typing as npt

from ccm_opt.files.export.arrays_npz import arrays_npz
from ccm_opt.files.export.folder import REACH_RECORD, write_folder
from ccm_opt.files.export.strict_json import strict_text
from ccm_opt.files.problem_file.problem_data import recorded_data
from ccm_opt.solution import ReachMap

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
