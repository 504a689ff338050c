"""Whether the texts of a folder agree with its arrays."""

import json
import re
import struct
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache, partial
from itertools import repeat
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.core.files import read_plain
from ccm_opt.io.controller_points import message_checks, slowed, spared
from ccm_opt.io.folder import model_texts
from ccm_opt.io.problem_data import mesh_data
from ccm_opt.io.robot_models import URDF_MESHES, mesh_file
from ccm_opt.io.scene_solids import solid_scene
from ccm_opt.io.solution_json import goal_data, room_data
from ccm_opt.io.trajectory_text import ROS_FIELDS, bending_joints, table_headings, trajectory_tables
from ccm_opt.problem import Problem
from ccm_opt.robot.frames import bends_from_revolutes
from ccm_opt.scene.bodies import MeshBody
from ccm_opt.solution import Check, JointStates, JointTrajectory, RoomRecord, goal_errors
from ccm_opt.verification.interpolated_message import Message
from ccm_opt.verification.verification_settings import DEFAULT_VERIFICATION

HEAD = 84
"""Bytes of a binary STL before its triangles, the last four of which are their number."""
TRIANGLE = np.dtype([("numbers", "<f4", (4, 3)), ("attributes", "<u2")])
"""A triangle of a binary STL: its normal and its corners."""
ROUNDING = 1e-6
"""By which a corner may be off, as a share of the mesh's size: the files have single precision."""


def mesh_defects(folder: Path, text: str, problem: Problem) -> Iterator[str]:
    """What of the meshes that a description names is otherwise than the problem says; of the plane nothing is known.

    Args:
        folder: of the description.
        text: of the description.
        problem: in space, whose meshes they are.
    """
    if problem.dimension == 2:
        return
    for obstacle in solid_scene(problem.workspace, problem.arm).obstacles:
        name = f"{URDF_MESHES}/{mesh_file(obstacle, 0)}"
        if isinstance(body := obstacle.solids[0], MeshBody) and name in text:
            yield from _defects_of_file(folder / name, name, body.triangles)


def _defects_of_file(path: Path, name: str, triangles: FloatArray) -> Iterator[str]:
    # A file of another size is not read, however large it is.
    if not path.is_file() or path.stat().st_size != HEAD + len(triangles) * TRIANGLE.itemsize:
        yield f"{name} is missing, or has another number of triangles than the problem's mesh"
        return
    content = path.read_bytes()
    (count,) = struct.unpack_from("<I", content, HEAD - 4)
    found = np.frombuffer(content, TRIANGLE, offset=HEAD)["numbers"][:, 1:].astype(np.float64)
    allowed = ROUNDING * float(np.max(np.abs(triangles)))
    # What is no number is off, too.
    off = ~(np.abs(found - triangles) <= allowed)
    if content.startswith(b"solid"):
        yield f"{name} begins as a file of text does, and other programs would read it as one"
    elif count != len(triangles) or np.any(off):
        number = int(np.argmax(np.any(off, axis=(1, 2)))) + 1
        yield f"{name} is not the problem's mesh, from triangle {number} on"


TEXT_TOLERANCE = 5.1e-12
"""Share by which a number of the table or the message may differ: twelve digits are written, and half of the last."""
TIME_TOLERANCE = 1e-9
"""Times may differ by this much, for a message counts whole nanoseconds, and places by the way in that time [s]."""
NUMBER_TOLERANCE = 1e-12
"""Share by which a number in a description of the arm may differ; all digits are written."""
MOST_TIMES_LONGER = 10
"""What is longer than a text need be by this factor is not read."""
LONGEST_NUMBER = 25
"""Characters of a number, its sign and what parts it from the next among them."""
LEAST_BYTES = 2**16
"""Files of no more are read in any case: short texts may have remarks in front that are longer than they are."""
NAMES = {
    "trajectory.csv": "table against arrays",
    "trajectory.yaml": "ROS message against arrays",
    "arm.urdf": "URDF against problem",
    "arm.mjcf.xml": "MJCF against problem",
}
"""Checks of the files."""
STAMP = re.compile(r"\{ *sec: *(\d{1,12}), *nanosec: *(\d{1,9}) *\}")
"""A time of a ROS message."""
LIST = re.compile(r"\[([-+.,0-9eE ]*)\]")
"""A list of numbers in it."""
DECLARATION = re.compile(r"\s*<\?xml(\s+version=([\"'])1\.0\2)?(\s+encoding=([\"'])(?i:utf-8|us-ascii)\4)?\s*\?>")
"""The only instruction that a description of an arm may have; other letters would make it another text elsewhere."""


@dataclass(frozen=True)
class _Points:
    """Points of a motion as a file has them.

    Attributes:
        names: of the joints.
        time: shape (P,) [s].
        tables: positions, velocities, accelerations and efforts, those that the file has, each of shape (P, joints).
    """

    names: tuple[str, ...]
    time: FloatArray
    tables: Mapping[str, FloatArray]


@dataclass(frozen=True)
class _Plan:
    """The motion in the arrays that points are held against."""

    problem: Problem
    trajectory: JointTrajectory
    joints: JointStates

    def samples_of(self, points: _Points) -> tuple[IntArray, float]:
        """Which samples the points are, and by which factor time is longer.

        Raises:
            ValueError: they are none, or not in order, or a stop or an end is not among them.
        """
        plan = self.trajectory
        factor = float(np.round(points.time[-1] / plan.duration, 4))
        if factor < 1.0:
            raise ValueError(f"it ends at {points.time[-1]:.9g} s, before the plan, which takes {plan.duration:.9g} s")
        after = np.clip(np.searchsorted(factor * plan.time, points.time), 1, len(plan.time) - 1)
        earlier = points.time - factor * plan.time[after - 1] < factor * plan.time[after] - points.time
        samples = np.where(earlier, after - 1, after)
        late = ~(np.abs(points.time - factor * plan.time[samples]) <= TIME_TOLERANCE)
        if np.any(late):
            raise ValueError(f"the time of point {int(np.argmax(late)) + 1} is not that of a sample of the plan")
        if np.any(np.diff(samples) <= 0):
            raise ValueError(f"point {int(np.argmax(np.diff(samples) <= 0)) + 2} is not later than the one before")
        missing = sorted({0, *plan.stops, len(plan.time) - 1} - set(samples.tolist()))
        if missing:
            raise ValueError(f"the start, the end or a stop is missing: t = {factor * plan.time[missing[0]]:.4f} s")
        return samples, factor

    def hold(self, points: _Points) -> tuple[IntArray, float]:
        """Hold points against the samples that they are.

        Returns:
            Their samples, and by which factor time is longer.

        Raises:
            ValueError: they differ.
        """
        samples, factor = self.samples_of(points)
        slower, states = slowed(self.problem, self.trajectory, self.joints, factor)
        variants = [trajectory_tables(slower, some) for some in (states, bending_joints(states, slower.coordinates))]
        tables = next((each for names, each in variants if names == points.names), None)
        if tables is None:
            raise ValueError("its joints are not those of the arm")
        wanted = dict(zip(ROS_FIELDS, tables, strict=True))
        for field, found in points.tables.items():
            if found.shape != (len(samples), len(points.names)):
                raise ValueError(f"{field} are not one number a joint")
            there = wanted[field][samples]
            allowed = TEXT_TOLERANCE * np.abs(there) + np.finfo(np.float64).tiny
            if field == "positions":
                allowed += TIME_TOLERANCE * np.abs(wanted["velocities"][samples])
            # What is no number, or infinite, differs: it is not less than any bound.
            wrong = ~(np.abs(found - there) <= allowed)
            if np.any(wrong):
                k, j = np.argwhere(wrong)[0]
                place = f"{field} of {points.names[j]} at t = {points.time[k]:.6g} s"
                raise ValueError(f"{place}: {found[k, j]:.12g}, not {there[k, j]:.12g}")
        return samples, factor

    def message(self, points: _Points) -> Message:
        """Points as a controller takes them, in the coordinates of the arm."""
        arm = self.problem.arm
        layout = self.trajectory.coordinates
        axes = len(layout.base_names)
        columns = [self.joints.names.index(name) for name in points.names[axes:]]

        def of_arm(values: FloatArray) -> FloatArray:
            revolutes = np.zeros((len(values), len(self.joints.names)))
            revolutes[:, columns] = values[:, axes:]
            bends = bends_from_revolutes(arm, revolutes)
            return np.column_stack((bends.reshape(len(bends), -1), values[:, :axes]))

        accelerations = points.tables.get("accelerations")
        return Message(
            points.time,
            of_arm(points.tables["positions"]),
            of_arm(points.tables["velocities"]),
            None if accelerations is None else of_arm(accelerations),
            layout,
        )


def checks_of_texts(
    folder: Path,
    problem: Problem,
    trajectory: JointTrajectory,
    joints: JointStates,
    checks: Sequence[Check],
) -> list[Check]:
    """Check each text file that is there; whoever deletes one loses it, and misleads nobody.

    Args:
        folder: an output folder.
        problem: whose arm is described.
        trajectory: the motion in the folder's arrays.
        joints: the same for all drives.
        checks: of the motion, which know the least gaps.
    """
    plan = _Plan(problem, trajectory, joints)
    numbers = len(trajectory.time) * (len(ROS_FIELDS) * (len(joints.names) + trajectory.positions.shape[1]) + 1)
    found = []
    described = lru_cache(partial(model_texts, problem))
    for name in NAMES:
        path = folder / name
        if not path.exists():
            continue
        if name in ("trajectory.csv", "trajectory.yaml"):
            read = _table if name == "trajectory.csv" else _message
            found += _checks_of_points(
                path, read, max(MOST_TIMES_LONGER * LONGEST_NUMBER * numbers, LEAST_BYTES), plan, checks
            )
        else:
            meshes = partial(mesh_defects, folder, problem=problem)
            length = len(described(obstacles=True, bends_only=False)[name])
            variants = (partial(_model_defects, wanted=text, meshes=meshes) for text in _descriptions(described, name))
            found.append(_check(path, variants, max(MOST_TIMES_LONGER * length, LEAST_BYTES)))
    return found


def _checks_of_points(
    path: Path, read: Callable[[str], _Points], most_bytes: int, plan: _Plan, checks: Sequence[Check]
) -> list[Check]:
    """Whether the points of a file are the plan's; those of a message also as a controller joins them."""
    said = ""
    try:
        points = read(_text(path, most_bytes))
        samples, factor = plan.hold(points)
    except (OSError, ValueError) as error:
        said = f"it is not readable, or differs: {error}"
    agrees = Check(NAMES[path.name], float(bool(said)), 0.0, "defects", said, passed=not said)
    if said or path.name == "trajectory.csv":
        return [agrees]
    spare = spared(plan.problem, checks)
    message = plan.message(points)
    return [agrees, *message_checks(plan.problem, plan.trajectory, message, samples, factor, spare)]


def _descriptions(described: Callable[..., Mapping[str, str]], name: str) -> Iterator[str]:
    """A description as ``solve`` writes it, and as ``ccm-opt export`` may have written it in its place."""
    for bends_only in (False, True):
        for obstacles in (True, False):
            yield described(obstacles=obstacles, bends_only=bends_only)[name]


def _check(path: Path, variants: Iterator[Callable[[str], Iterator[str]]], most_bytes: int) -> Check:
    """Whether a file is as one of several variants; what is said of it is how it differs from the first."""
    said = ""
    try:
        text = _text(path, most_bytes)
        for find in variants:
            defect = next(find(text), "")
            said = said or defect
            if not defect:
                said = ""
                break
    except (OSError, ValueError) as error:
        said = f"it is not readable: {error}"
    return Check(NAMES[path.name], float(bool(said)), 0.0, "defects", said, passed=not said)


def _text(path: Path, most_bytes: int) -> str:
    """A file's text, its lines ended as everywhere; of megabytes, so those that are so already are not looked for."""
    text = read_plain(path, most_bytes).decode("utf-8")
    return text.replace("\r\n", "\n").replace("\r", "\n") if "\r" in text else text


def _rows(lines: Sequence[str]) -> FloatArray:
    """Rows of numbers between commas; of one length, else ValueError."""
    if not lines or not all(lines):
        raise ValueError("it has no numbers, or a row without")
    return np.loadtxt(lines, delimiter=",", comments=None, ndmin=2)


def _table(text: str) -> _Points:
    """The points of ``trajectory.csv``."""
    head, _, body = text.partition("\n")
    columns = head.split(",")
    names = tuple(column.rpartition("_")[0] for column in columns[1 : 1 + len(columns) // len(ROS_FIELDS)])
    if columns != table_headings(names):
        raise ValueError("its columns are not time, and then angle, velocity, acceleration and torque of every joint")
    numbers = _rows(body.splitlines())
    parts = np.split(numbers[:, 1:], len(ROS_FIELDS), axis=1)
    return _Points(names, numbers[:, 0], dict(zip(ROS_FIELDS, parts, strict=True)))


def _message(text: str) -> _Points:
    """The points of ``trajectory.yaml``, which all have the same fields."""
    lines = [line.rstrip() for line in text.splitlines() if line.strip() and not line.lstrip().startswith("#")]
    field, _, value = lines[0].partition(": ") if lines else ("", "", "")
    if field != "joint_names" or lines[1:2] != ["points:"]:
        raise ValueError("it does not begin with joint_names and points")
    names = tuple(json.loads(value))
    starts = [k for k, line in enumerate(lines) if line.startswith("- ")]
    # Whatever else stood in it, such as a second list of points, other programs might take for the motion.
    points = [_point(lines[k:end]) for k, end in zip(starts, [*starts[1:], len(lines)], strict=True)]
    if starts[:1] != [2] or any(point.keys() != points[0].keys() for point in points):
        raise ValueError("its points are none, or not alike")
    stamps = _rows([point["time_from_start"] for point in points])
    tables = {field: _rows([point[field] for point in points]) for field in ROS_FIELDS if field in points[0]}
    return _Points(names, stamps @ (1.0, 1e-9), tables)


def _point(lines: Sequence[str]) -> Mapping[str, str]:
    """The numbers of a point of a message, by its fields."""
    point: dict[str, str] = {}
    for line, indent in zip(lines, ("- ", *repeat("  ", len(lines) - 1)), strict=True):
        field, _, value = line.removeprefix(indent).partition(": ")
        match = (STAMP if field == "time_from_start" else LIST).fullmatch(value)
        if not line.startswith(indent) or match is None or field in point:
            raise ValueError(f"{line[:60]!r} is nothing that a point has, or is there twice")
        point[field] = ",".join(match.groups())
    if not {"time_from_start", "positions", "velocities"} <= point.keys() <= {"time_from_start", *ROS_FIELDS}:
        raise ValueError(f"a point has {', '.join(point)}, not time_from_start, positions and velocities")
    return point


def _model_defects(text: str, wanted: str, meshes: Callable[[str], Iterator[str]]) -> Iterator[str]:
    """What of a description of the arm, and of the meshes that it names, is otherwise than the problem says."""
    if text != wanted:
        yield from _text_defects(text, wanted)
    yield from meshes(wanted)


def _text_defects(text: str, wanted: str) -> Iterator[str]:
    """What of a description that is written otherwise is otherwise by its content."""
    # Nothing here needs declarations, and entities could make a short text endless.
    if "<!" in text.replace("<!--", "") or "<?" in DECLARATION.sub("", text, count=1):
        yield "it has declarations or instructions, which no description of an arm needs"
        return
    try:
        found = ET.fromstring(text)  # noqa: S314 - without declarations there are no entities
    except ET.ParseError as error:
        yield f"it is not readable as XML: {error}"
        return
    yield from _differing_elements(found, ET.fromstring(wanted), "")  # noqa: S314 - our own text


def _differing_elements(found: ET.Element, wanted: ET.Element, path: str) -> Iterator[str]:
    here = f"{path}/{wanted.tag}" + (f" '{wanted.get('name')}'" if wanted.get("name") else "")
    if found.tag != wanted.tag:
        yield f"{here}: found <{found.tag}>"
        return
    for name in sorted(set(found.attrib) | set(wanted.attrib)):
        if not _same_text(found.get(name), wanted.get(name)):
            yield f"{here}: {name} is {found.get(name)!r}, not {wanted.get(name)!r}"
    texts = (
        (each.text or "").strip() + "".join([(part.tail or "").strip() for part in each]) for each in (found, wanted)
    )
    if not _same_text(*texts):
        yield f"{here}: its text is another"
    if len(found) != len(wanted):
        yield f"{here}: {len(found)} elements in it, not {len(wanted)}"
        return
    for ours, theirs in zip(found, wanted, strict=True):
        yield from _differing_elements(ours, theirs, here)


def _same_text(found: str | None, wanted: str | None) -> bool:
    """Whether two texts are alike, numbers in them by value."""
    if found is None or wanted is None or found == wanted:
        return found == wanted
    ours = found.split()
    theirs = wanted.split()
    return len(ours) == len(theirs) and all(map(_same_word, ours, theirs))


def _same_word(found: str, wanted: str) -> bool:
    try:
        value = float(wanted)
        # What Python alone takes for a number is none elsewhere.
        return "_" not in found and abs(float(found) - value) <= NUMBER_TOLERANCE * abs(value)
    except ValueError:
        return found == wanted


NAME = "record against motion"
_OF_MOTION = ("wanted_gap", "clearance", "reach", "nearest", "start", "stops", "goal", "short")
"""What of the room follows from the motion; what would have been possible, and what it costs, was found in planning."""
_OF_PLACES = ("gap", "wanted")
"""What is held of a place with little room; of several that are alike any may be named."""
_OF_MESHES = ("obstacle", "kept", "sha256", "triangles", "closed")
"""What is held of a mesh; where it was copied from is not known any more."""


def check_of_data(
    record: Mapping[str, object],
    problem: Problem,
    trajectory: JointTrajectory,
    room: RoomRecord,
    left_out: Sequence[str],
) -> Check:
    """One check for all of it; whatever a record does not have misleads nobody.

    Args:
        record: all of it.
        problem: in the record.
        trajectory: the motion, which passes every check of its own.
        room: that it keeps, measured anew.
        left_out: what nothing was held against, found anew.
    """
    wanted: dict[str, object] = {
        "method": problem.planner.method,
        "seed": problem.planner.seed,
        "not_checked": list(left_out),
        "room": {name: _of_places(value) for name, value in room_data(room).items() if name in _OF_MOTION},
    }
    if problem.dimension == 3:
        wanted["goal"] = goal_data(goal_errors(problem, trajectory.positions[-1]))
        wanted["meshes"] = [{name: mesh[name] for name in _OF_MESHES} for mesh in mesh_data(problem)]
    # Least gaps are known to a resolution only; everything else is far less off.
    allowed = DEFAULT_VERIFICATION.for_problem(problem).report_resolution
    wrong = [
        path for name, value in wanted.items() if name in record for path in _off(record[name], value, name, allowed)
    ]
    where = ", ".join(wrong[:5]) if wrong else f"{len(wanted)} agree"
    return Check(NAME, float(len(wrong)), 0.0, "that differ", where, passed=not wrong)


def _of_places(value: object) -> object:
    """The same without what is not held of places."""
    if isinstance(value, Mapping):
        if "nearest" in value:
            return {"nearest": _of_places(value["nearest"])}
        return {name: value[name] for name in _OF_PLACES}
    return [_of_places(each) for each in value] if isinstance(value, list) else value


def _off(found: object, wanted: object, path: str, allowed: float) -> Iterator[str]:
    """Paths of what differs; a table may have more than is wanted."""
    if isinstance(wanted, Mapping):
        if not isinstance(found, Mapping):
            yield path
            return
        for name, value in wanted.items():
            yield from _off(found.get(name), value, f"{path}.{name}", allowed)
    elif isinstance(wanted, list):
        if not isinstance(found, list) or len(found) != len(wanted):
            yield path
            return
        for k, (ours, theirs) in enumerate(zip(found, wanted, strict=True)):
            yield from _off(ours, theirs, f"{path}[{k}]", allowed)
    elif not _same(found, wanted, allowed):
        yield path


def _same(found: object, wanted: object, allowed: float) -> bool:
    if isinstance(wanted, float) and np.isfinite(wanted):
        return isinstance(found, (int, float)) and not isinstance(found, bool) and abs(found - wanted) <= allowed
    # Truth is no number: nought and one would be alike to it.
    return found == (None if isinstance(wanted, float) else wanted) and isinstance(found, bool) == isinstance(
        wanted, bool
    )
