"""Arrays of a motion, written and read."""

import warnings
import zipfile
from collections.abc import Collection, Mapping, Sequence
from io import BytesIO
from pathlib import Path

import numpy as np
import numpy.typing as npt

from ccm_opt.core.arrays import FloatArray
from ccm_opt.errors import ProblemError
from ccm_opt.robot.configuration import Configuration
from ccm_opt.robot.coordinates import Coordinates
from ccm_opt.solution import RoomRecord, Solution

_COMPRESSION = 1
"""Of arrays, from 1, fast, to 9, small. Measured on the plan of the swan's neck, 1.37 MB without: 615 kB in 14 ms at 1,
612 kB in 24 ms at 6."""


def solution_arrays(solution: Solution) -> dict[str, npt.NDArray[np.generic]]:
    """The arrays of a plan under the names of the file format; angles [rad], lengths [m], time [s]."""
    coordinates = solution.trajectory.coordinates
    return {
        "time": solution.trajectory.time,
        "bend_angles": by_joint(solution.trajectory.bend_angles, coordinates),
        "joint_names": np.array(solution.joints.names),
        "joint_angles": solution.joints.angles,
        "joint_velocities": solution.joints.velocities,
        "joint_accelerations": solution.joints.accelerations,
        "joint_torques": solution.joints.torques,
        "joint_positions": solution.joint_positions,
        "keyframes": by_joint(solution.path.keyframes[:, coordinates.bends], coordinates),
        **({} if solution.problem.dimension == 3 else curve_arrays(solution.path.curves)),
        "simulated_angles": solution.simulation.angles,
        "simulated_torques": solution.simulation.torques,
        "stops": np.array(solution.trajectory.stops, dtype=np.int64),
        **_feed_arrays(solution),
        **_room_arrays(solution.room),
    }


def by_joint(bends: FloatArray, coordinates: Coordinates) -> FloatArray:
    """Bends as they stand in files: as they are in the plane, in space the two of a joint in a row of their own."""
    if coordinates.bends_a_joint == 1:
        return bends
    return bends.reshape(*bends.shape[:-1], -1, coordinates.bends_a_joint)


def _feed_arrays(solution: Solution) -> dict[str, npt.NDArray[np.generic]]:
    """What the feed axis does; nothing for a fixed base, which has no column."""
    trajectory = solution.trajectory
    columns = {
        "base_feed": trajectory.base_positions,
        "feed_velocities": trajectory.base_velocities,
        "feed_accelerations": trajectory.base_accelerations,
        "feed_forces": solution.joints.base_forces,
        "keyframe_feeds": solution.path.keyframes[:, trajectory.coordinates.base],
        "simulated_feed": solution.simulation.base_positions,
    }
    return {name: column for name, values in columns.items() for column in values.T}


def _room_arrays(room: RoomRecord | None) -> dict[str, npt.NDArray[np.generic]]:
    """Gaps over time; nothing where nobody measured them."""
    if room is None:
        return {}
    return {"room_time": room.time, "wall_gaps": room.wall_gaps, "self_gaps": room.self_gaps}


def arrays_npz(arrays: dict[str, npt.NDArray[np.generic]]) -> bytes:
    """The content of an ``.npz`` file.

    The revolutes that a plane motion leaves alone are two thirds of many arrays; compressed, these zeros take no room.
    The same arrays give the same bytes, whenever they are written.
    """
    buffer = BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        for name, array in arrays.items():
            idle = array.ndim == 2 and not np.all(np.any(array != 0, axis=0))
            entry = zipfile.ZipInfo(f"{name}.npy")  # of the first day of 1980
            entry.compress_type = zipfile.ZIP_DEFLATED if idle else zipfile.ZIP_STORED
            content = BytesIO()
            np.lib.format.write_array(content, np.asanyarray(array), allow_pickle=False)
            archive.writestr(entry, content.getvalue(), compresslevel=_COMPRESSION if idle else None)
    return buffer.getvalue()


def bends_of_arrays(arrays: Mapping[str, npt.NDArray[np.generic]]) -> dict[str, npt.NDArray[np.generic]]:
    """The same arrays without the revolutes that bend nothing: in the plane two columns of three, in space one.

    Args:
        arrays: those of a plan, by name.
    """
    of_revolutes = {"joint_names"} | {f"joint_{what}" for what in ("angles", "velocities", "accelerations", "torques")}
    of_revolutes |= {"simulated_angles", "simulated_torques"}
    kept = [1] if arrays["bend_angles"].ndim == 2 else [0, 1]
    columns = np.flatnonzero(np.isin(np.arange(len(arrays["joint_names"])) % 3, kept))
    return {name: array[..., columns] if name in of_revolutes else array for name, array in arrays.items()}


def curve_arrays(curves: tuple[Configuration, ...]) -> dict[str, npt.NDArray[np.generic]]:
    """The curves behind the keyframes, segments end to end; those of curve k are offsets[k] to offsets[k + 1]."""
    segments = [segment for curve in curves for segment in curve.segments]
    return {
        "segments_offsets": np.cumsum([0, *(len(curve.segments) for curve in curves)]),
        "segment_lengths": np.array([segment.length for segment in segments], dtype=np.float64),
        "segment_curvatures": np.array([segment.curvature for segment in segments], dtype=np.float64).reshape(-1, 5),
        "segment_knots": np.array([segment.knots for segment in segments], dtype=np.float64).reshape(-1, 3),
        "base_headings": np.array([curve.base_heading for curve in curves], dtype=np.float64),
    }


MOST_BYTES_OF_ARRAYS = 2**29
"""Arrays that take more are not unpacked: a minute of motion of the longest arm takes less."""
_METHODS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
"""How numpy packs arrays; no other program has to unpack them in another way."""


def read_archive(path: Path, known: Collection[str]) -> dict[str, npt.NDArray[np.generic]]:
    """The arrays of a file, by name, as they stand there.

    Args:
        path: of the archive.
        known: names of the arrays that it may hold.

    Raises:
        ProblemError: it cannot be read, or holds anything else.
    """
    if not path.is_file():
        raise ProblemError(f"{path}: there is no such file; expected a folder written by 'ccm-opt solve'")
    try:
        members = _members(path)
        _check_members(path, members, {f"{name}.npy" for name in known})
        arrays = _arrays(path)
    except ProblemError:
        raise
    except Exception as error:  # archives and their heads are parsed by others, with errors of a dozen kinds
        raise ProblemError(f"{path}: not readable as arrays: {error}") from error
    for name, array in arrays.items():
        if not isinstance(array, np.ndarray):
            raise ProblemError(f"{path}: not readable as arrays: '{name}' is no array")
    return arrays


def _members(path: Path) -> Sequence[zipfile.ZipInfo]:
    """What is in an archive; nothing of it is unpacked."""
    if not zipfile.is_zipfile(path):
        raise ProblemError(f"{path}: not readable as arrays: it is not an .npz archive")
    with zipfile.ZipFile(path) as archive:
        return archive.infolist()


def _arrays(path: Path) -> dict[str, npt.NDArray[np.generic]]:
    """All that an archive unpacks to."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # of what numpy warns, and takes it all the same, it has not written
        with np.load(path, allow_pickle=False) as archive:
            return {name: archive[name] for name in archive.files}


def _check_members(path: Path, members: Sequence[zipfile.ZipInfo], known: Collection[str]) -> None:
    """Refuse, unread, an archive with anything but the arrays of the format, or with more than a plan can hold."""
    names = [member.filename for member in members]
    strange = next((name for name in names if name not in known or names.count(name) > 1), None)
    if strange is not None:
        raise ProblemError(f"{path}: holds '{strange[:60]}', which is none of the arrays of a plan, or is there twice")
    packed = next((member.filename for member in members if member.compress_type not in _METHODS), None)
    if packed is not None:
        raise ProblemError(f"{path}: '{packed}' is packed in a way that numpy does not pack arrays in")
    size = sum(member.file_size for member in members)
    if size > MOST_BYTES_OF_ARRAYS:
        raise ProblemError(f"{path}: its arrays take {size} bytes unpacked, at most {MOST_BYTES_OF_ARRAYS} are read")
