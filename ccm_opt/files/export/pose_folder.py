"""The folder of a pose, written whole or not at all."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import numpy.typing as npt

from ccm_opt.files.export.arrays_npz import arrays_npz, curve_arrays
from ccm_opt.files.export.folder import POSE_ARRAYS, POSE_RECORD, write_folder
from ccm_opt.files.export.pose_json import pose_json
from ccm_opt.solution import StaticPose


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
