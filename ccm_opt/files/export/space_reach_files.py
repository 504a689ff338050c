"""The folder of a map of reach in space, written whole or not at all."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import numpy.typing as npt

from ccm_opt.files.export.arrays_npz import arrays_npz
from ccm_opt.files.export.folder import REACH_RECORD, write_folder
from ccm_opt.files.export.reach_folder import SCHEMA
from ccm_opt.files.export.space_record import mesh_data, space_recorded_data
from ccm_opt.files.export.space_scene import kept_meshes
from ccm_opt.files.export.strict_json import strict_text
from ccm_opt.space.space_reach_map import SpaceReachMap


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
