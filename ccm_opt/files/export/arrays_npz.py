"""The file ``solution.npz``: every array of a plan, uncompressed, without pickles."""

from io import BytesIO

import numpy as np
import numpy.typing as npt

from ccm_opt.continuum.configuration import Configuration
from ccm_opt.solution import RoomRecord, Solution


def solution_arrays(solution: Solution) -> dict[str, npt.NDArray[np.generic]]:
    """The arrays of a plan under the names of the file format; angles [rad], lengths [m], time [s]."""
    return {
        "time": solution.trajectory.time,
        "bend_angles": solution.trajectory.bend_angles,
        "joint_names": np.array(solution.joints.names),
        "joint_angles": solution.joints.angles,
        "joint_velocities": solution.joints.velocities,
        "joint_accelerations": solution.joints.accelerations,
        "joint_torques": solution.joints.torques,
        "joint_positions": solution.joint_positions,
        "keyframes": solution.path.keyframes[:, solution.trajectory.coordinates.bends],
        **curve_arrays(solution.path.curves),
        "simulated_angles": solution.simulation.angles,
        "simulated_torques": solution.simulation.torques,
        "stops": np.array(solution.trajectory.stops, dtype=np.int64),
        **_feed_arrays(solution),
        **_room_arrays(solution.room),
    }


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
    """The content of an ``.npz`` file."""
    buffer = BytesIO()
    np.savez(buffer, **arrays)  # type: ignore[arg-type]  # numpy's stub takes the keyword allow_pickle for one of them
    return buffer.getvalue()


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
