"""Reading of output folders for the commands check, simulate and export; all content is checked before use.

The record of results is read by ``record_reading``.
"""

import math
import warnings
import zipfile
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import ProblemError, VerificationError
from ccm_opt.io.folder import ARRAYS, RECORD
from ccm_opt.io.reading import problem_from_mapping
from ccm_opt.io.record_reading import RecordedResults, number_or_none, read_record
from ccm_opt.io.records import AXIS_NAMES, PARTIAL, SCHEMA, drive_arrays
from ccm_opt.problem import Problem, Stop
from ccm_opt.problem.solution import (
    JointStates,
    JointTrajectory,
    SimulatedMotion,
    SimulationVerdict,
    Tour,
    UnvisitedGoal,
)
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.frames import bends_from_revolutes, drive_names, joint_names
from ccm_opt.scene.tool_links import points_with_tool


def recorded_simulation(motion: "SavedMotion", recorded: RecordedResults) -> SimulatedMotion:
    """Return the simulated motion that an output folder records.

    Raises:
        ProblemError: its verdict is malformed.
    """
    known: dict[str, Any] = {field.name: recorded.verdict.get(field.name, field.default) for field in _VERDICT}
    error, saturated = (recorded.figures.get(name) for name in ("tracking_error_rad", "saturated_time_s"))
    try:
        verdict = SimulationVerdict(**known | {"advice": tuple(map(str, known["advice"]))})
        return SimulatedMotion(
            angles=motion.simulated_angles,
            torques=motion.simulated_torques,
            tracking_error=math.nan if error is None else error,
            saturated=bool(saturated),
            base_positions=motion.simulated_base,
            saturated_time=saturated or 0.0,
            verdict=verdict,
        )
    except TypeError as error_in_it:
        raise ProblemError(f"{RECORD}: the simulation in it is not readable: {error_in_it}") from error_in_it


_VERDICT = fields(SimulationVerdict)


POSITION_TOLERANCE = 1e-9
"""Allowed difference between stored joint positions and those that follow from the stored angles, as a fraction of the
arm's length."""

Shapes = Mapping[str, tuple[str | int, ...]]

SHAPES: Shapes = {
    "time": ("samples",),
    "bend_angles": ("samples", "links"),
    "joint_names": ("revolutes",),
    "joint_angles": ("samples", "revolutes"),
    "joint_velocities": ("samples", "revolutes"),
    "joint_accelerations": ("samples", "revolutes"),
    "joint_torques": ("samples", "revolutes"),
    "joint_positions": ("samples", "points", 2),
    "keyframes": ("keyframes", "links"),
    "segments_offsets": ("offsets",),
    "segment_lengths": ("segments",),
    "segment_curvatures": ("segments", 5),
    "segment_knots": ("segments", 3),
    "base_headings": ("curves",),
    "simulated_angles": ("samples", "revolutes"),
    "simulated_torques": ("samples", "revolutes"),
    "stops": ("stops",),
}
"""Shapes of the arrays of ``solution.npz``, by name; equal words stand for equal sizes."""
SPACE_SHAPES: Shapes = {
    **{name: shape for name, shape in SHAPES.items() if not name.startswith("segment") and name != "base_headings"},
    "bend_angles": ("samples", "links", 2),
    "joint_positions": ("samples", "points", 3),
    "keyframes": ("keyframes", "links", 2),
}
"""Shapes of the arrays of ``solution.npz`` for an arm in space, which has no planar backbone curves."""
TOOL_TIP = "tool_tip"
"""Name of the array of ``solution.npz`` with the positions of the tool's tip."""
FEED_SHAPES: Shapes = {
    "base_feed": ("samples",),
    "feed_velocities": ("samples",),
    "feed_accelerations": ("samples",),
    "feed_forces": ("samples",),
    "simulated_feed": ("samples",),
    "keyframe_feeds": ("keyframes",),
}
"""Shapes of the additional arrays of ``solution.npz`` for an arm with a feed axis."""
DRIVE_ARRAYS = (
    "drive_names",
    "drive_values",
    "section_curvatures",
    "section_azimuths",
    "section_lengths",
    "tendon_lengths",
    "drive_torques",
    "tendon_tensions",
)
"""Names of the additional arrays of ``solution.npz`` for sections that bend evenly."""
AXES_SHAPES: Shapes = {name: (*FEED_SHAPES[of_feed], "axes") for of_feed, name in AXIS_NAMES.items()}
"""Shapes of the additional arrays of ``solution.npz`` for an arm on other base axes."""
CLEARANCE_SHAPES: Shapes = {"room_time": ("looks",), "wall_gaps": ("looks",), "self_gaps": ("looks",)}
"""Shapes of the additional arrays of ``solution.npz`` where the clearance of the motion was measured."""


@dataclass(frozen=True)
class SavedMotion:
    """The motion stored in an output folder, with T samples and n links.

    Attributes:
        trajectory: the timed motion.
        joints: states of all revolute joints over the motion, with efforts.
        keyframes: the planner's K keyframes, one column per coordinate of the arm, shape (K, c) [rad, m].
        simulated_angles: angles of the simulated arm's revolute joints, shape (T, 3 n) [rad].
        simulated_torques: torques of the simulated arm's revolute joints, shape (T, 3 n), or of the m drives of
            sections that bend evenly, shape (T, m) [N m].
        simulated_base: feed of the simulated arm, shape (T, 1), or (T, 0) for a fixed base [m]. There are no samples of
            an arm that is not simulated.
        arrays: all arrays of the file except the names of the joints, as stored.
    """

    trajectory: JointTrajectory
    joints: JointStates
    keyframes: FloatArray
    simulated_angles: FloatArray
    simulated_torques: FloatArray
    simulated_base: FloatArray
    arrays: Mapping[str, FloatArray]

    @property
    def clearance_arrays(self) -> Mapping[str, FloatArray]:
        """Times and clearances of the motion by array name, each of shape (N,); empty if they were not measured."""
        return {name: self.arrays[name] for name in CLEARANCE_SHAPES if name in self.arrays}


def load_problem_data(folder: Path) -> Mapping[str, object]:
    """Return the copy of the problem file that is stored in an output folder's ``solution.json``, as parsed data.

    Args:
        folder: an output folder.

    Returns:
        Tables of the problem file, from which ``problem_from_mapping`` rebuilds the problem.

    Raises:
        ProblemError: there is no folder, or it has no readable record of a known schema.
        VerificationError: the record is that of a run without a plan.
    """
    record = read_record(folder / RECORD)
    if (schema := record.get("schema")) != SCHEMA or type(schema) is not int:
        raise ProblemError(
            f"{folder / RECORD}: schema is {schema!r}; this version reads schema {SCHEMA}; check the folder "
            "with the version of ccm-opt that wrote it"
        )
    status = record.get("status")
    if status not in {"solved", PARTIAL}:
        diagnosis = record.get("diagnosis")
        reason = f"; {diagnosis['reason']}" if isinstance(diagnosis, Mapping) and "reason" in diagnosis else ""
        raise VerificationError([f"there is no plan to check in {folder}: its status is {status!r}{reason}"])
    data = record.get("problem")
    if not isinstance(data, Mapping):
        raise ProblemError(f"{folder / RECORD}: expected a table under 'problem', got {type(data).__name__}")
    return data


def load_any_problem(folder: Path) -> Problem:
    """Return the problem solved by the plan in an output folder, with meshes read from copies in that folder.

    Of goals in free order, it has those that the plan visits, in the order of the visits.

    Args:
        folder: an output folder.

    Raises:
        ProblemError: the record is missing or unreadable, or its problem has defects.
        VerificationError: the record is that of a run without a plan.
    """
    problem, tour = load_posed(folder)
    return problem if tour is None else tour.visited


def load_posed(folder: Path) -> tuple[Problem, Tour | None]:
    """Return the problem of an output folder as posed, and the order in which its plan visits goals in free order.

    Args:
        folder: an output folder.

    Raises:
        ProblemError: the record is missing or unreadable, its problem has defects, or its tour is not one of the goals.
        VerificationError: the record is that of a run without a plan.
    """
    posed = load_problem_data(folder)
    problem = problem_from_mapping(posed, str(folder / RECORD), folder)
    record: Mapping[str, Any] = read_record(folder / RECORD)
    data = record.get("tour")
    if (problem.planner.order == "free") != (data is not None):
        raise ProblemError(f'{folder / RECORD}: "tour" goes together with goals in free order')
    if data is None:
        return problem, None
    views: tuple[Stop, ...] = ()
    fewest, unseen = 0, tuple[str, ...]()
    if problem.coverage is not None:
        try:
            tables, fewest, unseen = list(data["views"]), int(data["fewest"]), tuple(map(str, data["unseen"]))
        except (KeyError, TypeError, ValueError, OverflowError) as error:
            raise ProblemError(f"{folder / RECORD}: the views of the tour in it are not readable: {error}") from error
        # The views are goals of the same problem.
        views = tuple(problem_from_mapping({**posed, "goal": tables}, str(folder / RECORD), folder).numbered_goals)
    goals = range(1, len(views or problem.goals) + 1)
    try:
        left_out = tuple(
            UnvisitedGoal(each["goal"], str(each["status"]), str(each["reason"])) for each in data["left_out"]
        )
        order = tuple(data["order"])
        times = [number_or_none(data[name]) or 0.0 for name in ("duration", "bound", "as_given")]
    except (AttributeError, KeyError, TypeError, ValueError, OverflowError) as error:
        raise ProblemError(f"{folder / RECORD}: the tour in it is not readable: {error}") from error
    if not order or any(type(k) is not int or k not in goals for k in [*order, *(goal.goal for goal in left_out)]):
        raise ProblemError(f"{folder / RECORD}: the tour has something other than numbers of the {len(goals)} goals")
    if (record["status"] == PARTIAL) != bool(left_out):
        raise ProblemError(f"{folder / RECORD}: the status is {record['status']!r} with {len(left_out)} goals left out")
    duration, bound, as_given = times
    return problem, Tour(problem, order, left_out, duration, bound, as_given, views, fewest, unseen)


def load_motion(folder: Path, arm: Arm) -> SavedMotion:
    """Return the motion stored in the ``solution.npz`` of an output folder.

    Args:
        folder: an output folder.
        arm: the arm that moves.

    Returns:
        The motion; velocities and accelerations of the joint angles are taken from those of the revolute joints.

    Raises:
        ProblemError: an array is missing, has a wrong shape or type, is not finite, or contradicts another array.
    """
    path = folder / ARRAYS
    arrays = read_arrays(path)
    arrays.setdefault("stops", np.zeros(0, dtype=np.int64))  # folders of earlier versions have none
    shapes = {
        **(SPACE_SHAPES if arm.dimension == 3 else SHAPES),
        **(FEED_SHAPES if arm.feed is not None else {}),
        **(AXES_SHAPES if arm.carrier else {}),
        **({} if arm.drives is None else {"simulated_torques": ("samples", len(drive_names(arm)))}),
        **({} if arm.tool is None else {TOOL_TIP: ("samples", arm.dimension)}),
        **(CLEARANCE_SHAPES if CLEARANCE_SHAPES.keys() & arrays.keys() else {}),
    }
    if arm.unsimulated:
        shapes = {name: shape for name, shape in shapes.items() if not name.startswith("simulated")}
    _check_shapes(arrays, path, arm.links, shapes)
    names = tuple(arrays["joint_names"].tolist())
    if names != joint_names(arm):
        raise ProblemError(
            f"{path}: joint_names differ from those of this arm, which begin with {joint_names(arm)[:3]}"
        )
    numbers = {name: np.asarray(arrays[name], dtype=np.float64) for name in shapes if name != "joint_names"}

    def of_base(name: str, rows_of: str = "time") -> FloatArray:
        """Return an array of the k base axes as columns, shape (T, k); a fixed base has none."""
        name = AXIS_NAMES[name] if arm.carrier else name
        columns = [numbers[name]] if name in numbers else []
        return np.column_stack([np.zeros((len(numbers[rows_of]), 0)), *columns])

    joints = JointStates(
        names,
        numbers["joint_angles"],
        numbers["joint_velocities"],
        numbers["joint_accelerations"],
        numbers["joint_torques"],
        base_forces=of_base("feed_forces"),
    )
    stops = numbers["stops"]
    samples = len(numbers["time"])
    if np.any((stops < 0) | (stops >= samples) | (stops != np.floor(stops))):
        raise ProblemError(f"{path}: the array 'stops' contains something other than indices of the {samples} samples")
    trajectory = JointTrajectory(
        numbers["time"],
        # In space, the stored array has the two bends of a joint on an axis of their own.
        np.column_stack((numbers["bend_angles"].reshape(samples, -1), of_base("base_feed"))),
        np.column_stack((bends_from_revolutes(arm, joints.velocities), of_base("feed_velocities"))),
        np.column_stack((bends_from_revolutes(arm, joints.accelerations), of_base("feed_accelerations"))),
        arm.coordinates,
        tuple(int(k) for k in stops),
    )
    keyframes = numbers["keyframes"].reshape(len(numbers["keyframes"]), -1)
    motion = SavedMotion(
        trajectory,
        joints,
        np.column_stack((keyframes, of_base("keyframe_feeds", "keyframes"))),
        numbers.get("simulated_angles", np.zeros((0, 3 * arm.links))),
        numbers.get("simulated_torques", np.zeros((0, len(drive_names(arm))))),
        of_base("simulated_feed") if not arm.unsimulated else np.zeros((0, len(arm.base_axes))),
        numbers,
    )
    for name, values in drive_arrays(arm, trajectory.bend_angles, joints.torques).items():
        stored = arrays.get(name, np.zeros(0))
        same = stored.shape == values.shape and (
            bool(np.all(stored == values)) if values.dtype.kind == "U" else np.allclose(stored, values, 1e-9, 1e-9)
        )
        if not same:
            raise ProblemError(f"{path}: {name} is missing, or differs from those of the joints; the file was changed")
    places = {"joint_positions": arm.joint_positions_at(trajectory.positions)}
    if arm.tool is not None:
        places[TOOL_TIP] = points_with_tool(arm, trajectory.positions)[:, -1]
    for name, expected in places.items():
        error = float(np.abs(numbers[name] - expected).max())
        if not error <= POSITION_TOLERANCE * arm.length:
            raise ProblemError(f"{path}: {name} differ from bend_angles by up to {error:.3g} m; the file was changed")
    return motion


def read_arrays(path: Path) -> dict[str, npt.NDArray[np.generic]]:
    """Return the arrays of a ``solution.npz`` file as stored, by name.

    Raises:
        ProblemError: the file cannot be read.
    """
    return read_archive(path, (*SHAPES, *FEED_SHAPES, *AXES_SHAPES, *CLEARANCE_SHAPES, *DRIVE_ARRAYS, TOOL_TIP))


MOST_BYTES_OF_ARRAYS = 2**29
"""Maximum unpacked size of an archive [bytes]; a minute of motion of the arm with the most links takes less."""
_METHODS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
"""Accepted compression methods, namely those that NumPy uses, so that every NumPy can read the file."""


def read_archive(path: Path, known: Collection[str]) -> dict[str, npt.NDArray[np.generic]]:
    """Return the arrays of an ``.npz`` file as stored, by name.

    Args:
        path: path of the archive.
        known: names of the arrays that it may contain.

    Raises:
        ProblemError: the file cannot be read, or contains an array of another name.
    """
    if not path.is_file():
        raise ProblemError(f"{path}: there is no such file; expected a folder written by 'ccm-opt solve'")
    if not zipfile.is_zipfile(path):
        raise ProblemError(f"{path}: not readable as arrays: it is not an .npz archive")
    try:
        with zipfile.ZipFile(path) as archive:
            _check_members(path, archive.infolist(), {f"{name}.npy" for name in known})
        with warnings.catch_warnings():
            warnings.simplefilter("error")  # numpy reads some malformed files with a warning
            with np.load(path, allow_pickle=False) as loaded:
                arrays = {name: loaded[name] for name in loaded.files}
    except ProblemError:
        raise
    except Exception as error:  # the parsers of zip and npy raise errors of many types
        raise ProblemError(f"{path}: not readable as arrays: {error}") from error
    for name, array in arrays.items():
        if not isinstance(array, np.ndarray):
            raise ProblemError(f"{path}: not readable as arrays: '{name}' is not an array")
    return arrays


def _check_members(path: Path, members: Sequence[zipfile.ZipInfo], known: Collection[str]) -> None:
    """Refuse, before unpacking, an archive with unknown or repeated members, unusual compression, or too much data.

    Raises:
        ProblemError: the archive is refused.
    """
    names = [member.filename for member in members]
    strange = next((name for name in names if name not in known or names.count(name) > 1), None)
    if strange is not None:
        raise ProblemError(f"{path}: contains '{strange[:60]}', which is not an array of a plan, or occurs twice")
    packed = next((member.filename for member in members if member.compress_type not in _METHODS), None)
    if packed is not None:
        raise ProblemError(f"{path}: '{packed}' is compressed by a method that numpy does not use")
    size = sum(member.file_size for member in members)
    if size > MOST_BYTES_OF_ARRAYS:
        raise ProblemError(f"{path}: its arrays take {size} bytes unpacked; at most {MOST_BYTES_OF_ARRAYS} are read")


def _check_shapes(arrays: Mapping[str, npt.NDArray[np.generic]], path: Path, links: int, shapes: Shapes) -> None:
    """Check that all arrays are present, numeric and finite, and have consistent shapes.

    Args:
        arrays: arrays by name.
        path: path of the file, for messages.
        links: number of links of the arm.
        shapes: expected shape of each array, by name; equal words stand for equal sizes.

    Raises:
        ProblemError: an array is missing or unusable, or its shape contradicts that of another.
    """
    sizes = {"links": links, "revolutes": 3 * links, "points": links + 1}
    for name, shape in shapes.items():
        if name not in arrays:
            raise ProblemError(f"{path}: the array '{name}' is missing")
        array = arrays[name]
        # The first array with a named size fixes it for all others.
        wanted = tuple(
            sizes.setdefault(size, got) if isinstance(size, str) else size
            for size, got in zip(shape, array.shape, strict=False)
        )
        if array.shape != wanted or len(shape) != array.ndim:
            raise ProblemError(f"{path}: the array '{name}' has shape {array.shape}; expected {shape} with {sizes}")
        if name != "joint_names" and (array.dtype.kind not in "fiu" or not np.isfinite(array.astype(np.float64)).all()):
            raise ProblemError(
                f"{path}: the array '{name}' of type {array.dtype} contains something that is not a finite number"
            )
    for name, least, words in (("samples", 2, "two samples"), ("keyframes", 1, "one keyframe")):
        if sizes[name] < least:
            raise ProblemError(f"{path}: a motion needs at least {words}, got {sizes[name]}")
