"""The file ``solution.npz``: every array of a plan, without pickles."""

import zipfile
from collections.abc import Mapping
from io import BytesIO

import numpy as np
import numpy.typing as npt

from ccm_opt.continuum.configuration import Configuration
from ccm_opt.files.export.export_settings import EXPORT, ExportSettings
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.jointed.coordinates import Coordinates
from ccm_opt.solution import RoomRecord
from ccm_opt.space.space_solution import AnySolution, SpaceSolution


def solution_arrays(solution: AnySolution) -> dict[str, npt.NDArray[np.generic]]:
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
        **({} if isinstance(solution, SpaceSolution) else curve_arrays(solution.path.curves)),
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


def _feed_arrays(solution: AnySolution) -> dict[str, npt.NDArray[np.generic]]:
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


def arrays_npz(arrays: dict[str, npt.NDArray[np.generic]], settings: ExportSettings = EXPORT) -> bytes:
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
            archive.writestr(entry, content.getvalue(), compresslevel=settings.compression if idle else None)
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
