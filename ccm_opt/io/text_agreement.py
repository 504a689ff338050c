"""Checks that the text files of an output folder (trajectories, robot models, record) agree with its arrays.

Each text is compared line by line, numbers by value, with the text that would be written today. The times in a
trajectory file show which samples of the plan the file contains, and by which factor its motion is slowed down.
"""

import re
import struct
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import partial
from itertools import takewhile
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.core.files import read_plain
from ccm_opt.io.controller_points import (
    ROS_FIELDS,
    ControllerPoints,
    message_checks,
    points_at,
    slowed,
    spared,
    trajectory_texts,
)
from ccm_opt.io.folder import model_texts
from ccm_opt.io.problem_data import mesh_data
from ccm_opt.io.records import clearance_data, goal_data
from ccm_opt.io.robot_models import URDF_MESHES, mesh_file
from ccm_opt.io.scene_solids import solid_scene
from ccm_opt.problem import Problem
from ccm_opt.problem.solution import Check, ClearanceRecord, JointStates, JointTrajectory, goal_errors
from ccm_opt.verification.verification_settings import DEFAULT_VERIFICATION

HEAD = 84
"""Size of the header of a binary STL file, whose last four bytes hold the number of triangles [bytes]."""
TRIANGLE = np.dtype([("numbers", "<f4", (4, 3)), ("attributes", "<u2")])
"""Record of a triangle in a binary STL file: normal, three corners, and attributes."""
ROUNDING = 1e-6
"""Allowed deviation of a corner, as a fraction of the largest coordinate: STL files have single precision."""


def mesh_defects(folder: Path, text: str, problem: Problem) -> Iterator[str]:
    """Yield a sentence for each mesh file to which a robot model refers and which differs from the problem's mesh.

    Only meshes of obstacles in space are checked, not those of extruded obstacles.

    Args:
        folder: folder of the robot model.
        text: text of the robot model (URDF or MJCF).
        problem: the problem.
    """
    scene = solid_scene(problem.workspace, problem.arm)
    for k, _, _ in problem.workspace.meshes:
        name = f"{URDF_MESHES}/{mesh_file(scene, scene.obstacles[k], 0)}"
        if name in text:
            yield from _file_defects(folder / name, name, scene.obstacles[k].solids[0].triangles)


def _file_defects(path: Path, name: str, triangles: FloatArray) -> Iterator[str]:
    # A file of the wrong size is not read, since it may be huge.
    if not path.is_file() or path.stat().st_size != HEAD + len(triangles) * TRIANGLE.itemsize:
        yield f"{name} is missing, or differs from the problem's mesh in the number of triangles"
        return
    content = path.read_bytes()
    (count,) = struct.unpack_from("<I", content, HEAD - 4)
    found = np.frombuffer(content, TRIANGLE, offset=HEAD)["numbers"][:, 1:].astype(np.float64)
    allowed = ROUNDING * float(np.max(np.abs(triangles)))
    # Written so that NaN counts as a deviation.
    off = ~(np.abs(found - triangles) <= allowed)
    if content.startswith(b"solid"):
        yield f"{name} begins like a text STL, and other programs would read it as one"
    elif count != len(triangles) or np.any(off):
        number = int(np.argmax(np.any(off, axis=(1, 2)))) + 1
        yield f"{name} differs from the problem's mesh from triangle {number} on"


POINT_TOLERANCE = 1.01e-11
"""Allowed relative difference of numbers in trajectory files: the last of twelve digits may differ."""
TIME_TOLERANCE = 1e-9
"""Allowed difference of times, since ROS messages count whole nanoseconds [s]."""
NUMBER_TOLERANCE = 1e-12
"""Allowed relative difference of numbers in robot models (URDF, MJCF), which are written with all digits."""
ZERO = 1e-15
"""Difference of numbers that is left of sums and products of ones, where the result would be zero."""
MOST_TIMES_LONGER = 10
"""Ratio of a file's length to the expected length above which the file is not read."""
LONGEST_NUMBER = 25
"""Maximum length of a number with its sign and separator [characters]."""
LEAST_BYTES = 2**16
"""Size up to which files are always read, since comments may be longer than a short text [bytes]."""
NAMES = {
    "trajectory.csv": "table against arrays",
    "trajectory.yaml": "ROS message against arrays",
    "arm.urdf": "URDF against problem",
    "arm.mjcf.xml": "MJCF against problem",
}
"""Names of the checks, by file name."""
STAMP = re.compile(r"\{ *sec: *(\d{1,12}), *nanosec: *(\d{1,9}) *\}")
"""A time in a ROS message in YAML form."""
DECLARATION = re.compile(r"\s*<\?xml(\s+version=([\"'])1\.0\2)?(\s+encoding=([\"'])(?i:utf-8|us-ascii)\4)?\s*\?>")
"""The only processing instruction allowed in a robot model; with another encoding, other programs would read a
different text."""
NUMBER = re.compile(r"(?<![\w.])([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)(?![\w.])")
"""A decimal number that is not part of a name."""


def text_checks(
    folder: Path,
    problem: Problem,
    trajectory: JointTrajectory,
    joints: JointStates,
    checks: Sequence[Check],
) -> list[Check]:
    """Return the checks of the trajectory files and robot models in an output folder against the plan.

    A missing file is not a defect, since it cannot mislead anybody.

    Args:
        folder: an output folder.
        problem: the problem solved by the plan.
        trajectory: the motion in the folder's arrays.
        joints: angles, velocities, accelerations and efforts of all revolute joints over the motion.
        checks: verifier's checks of the motion, which hold its minimum clearances.
    """
    plan = (problem, trajectory, joints)
    numbers = len(trajectory.time) * (len(ROS_FIELDS) * (len(joints.names) + trajectory.positions.shape[1]) + 1)
    longest = LONGEST_NUMBER * numbers
    found = []
    # The description as ``solve`` writes it, and the variants with which ``ccm-opt export`` may have replaced it.
    described = [
        model_texts(problem, obstacles=obstacles, bends_only=bends_only)
        for bends_only in (False, True)
        for obstacles in (True, False)
        if problem.arm.sections is None  # others have no such description
    ]
    for name in NAMES:
        points: list[ControllerPoints] = []
        if name.startswith("trajectory"):
            find = partial(_point_defect, plan=plan, of_table=name.endswith("csv"), found=points)
        elif not described:
            continue
        else:
            texts = [each[name] for each in described]
            find = partial(_model_defect, folder=folder, problem=problem, texts=texts)
            longest = len(texts[0])
        if (folder / name).exists():
            check = _check(folder / name, find, max(MOST_TIMES_LONGER * longest, LEAST_BYTES))
            found.append(check)
            if check.passed and name == "trajectory.yaml":
                (of_file,) = points
                spare = spared(problem, checks)
                found += message_checks(problem, trajectory, of_file.message, of_file.samples, of_file.factor, spare)
    return found


def _check(path: Path, find: Callable[[str], str], most_bytes: int) -> Check:
    """Return the check that a text file agrees with the plan.

    Args:
        path: path of the file.
        find: function that, given the file's text, returns its first difference from the expected text in words, or ""
            if there is none.
        most_bytes: maximum size [bytes]; larger files fail the check unread.
    """
    try:
        text = read_plain(path, most_bytes).decode("utf-8")
        said = find(text.replace("\r\n", "\n").replace("\r", "\n"))
    except (OSError, ValueError) as error:
        said = f"not readable, or different: {error}"
    return Check(NAMES[path.name], float(bool(said)), 0.0, "defects", said, passed=not said)


def _point_defect(
    text: str, plan: tuple[Problem, JointTrajectory, JointStates], found: list[ControllerPoints], *, of_table: bool
) -> str:
    """Return the first difference between a trajectory file and the plan, in words; empty if they agree.

    Args:
        text: text of the file.
        plan: problem, motion, and states of all revolute joints over the motion.
        found: receives the trajectory points that the file should contain.
        of_table: whether the file is the CSV table rather than the ROS message.

    Raises:
        ValueError: the times in the file are not those of samples of the plan.
    """
    lines = _point_lines(text)
    stamps = (
        [line.partition(",")[0] for line in lines[1:]]
        if of_table
        else [f"{int(seconds)}.{int(parts):09d}" for seconds, parts in STAMP.findall(text)]
    )
    time = np.array(stamps, dtype=np.float64)
    samples, factor = _matching_samples(time, plan[1])
    states = slowed(*plan, factor)
    smooth = of_table or any(line.startswith("  accelerations: ") for line in lines)
    found.append(points_at(*states, samples, factor, smooth=smooth, time=time))
    effort = any(line.startswith("  effort: ") for line in lines)
    written = (
        trajectory_texts(found[0], plan[0].arm, bends_only=bends_only, effort=effort) for bends_only in (False, True)
    )
    return _difference(lines, (_point_lines(texts[not of_table]) for texts in written), POINT_TOLERANCE)


def _point_lines(text: str) -> list[str]:
    """Return the lines of a text without blank lines and comments."""
    return [line.rstrip() for line in text.splitlines() if line.strip() and not line.lstrip().startswith("#")]


def _matching_samples(time: FloatArray, plan: JointTrajectory) -> tuple[IntArray, float]:
    """Return the samples of a plan at the times in a trajectory file, and the factor by which the file is slower.

    Args:
        time: times of the P points in the file, shape (P,) [s].
        plan: the planned motion.

    Returns:
        Indices of the samples, shape (P,), and the time factor, at least 1.

    Raises:
        ValueError: a time belongs to no sample, times are not increasing, or an end or stop of the plan is missing.
    """
    if not len(time) or not np.isfinite(time).all():
        raise ValueError("it has no points, or a time that is not a number")
    factor = float(np.round(time[-1] / plan.duration, 4))
    if factor < 1.0:
        raise ValueError(f"it ends at {time[-1]:.9g} s, before the plan's end at {plan.duration:.9g} s")
    after = np.clip(np.searchsorted(factor * plan.time, time), 1, len(plan.time) - 1)
    samples = np.where(time - factor * plan.time[after - 1] < factor * plan.time[after] - time, after - 1, after)
    late = ~(np.abs(time - factor * plan.time[samples]) <= TIME_TOLERANCE)
    if np.any(late):
        raise ValueError(f"the time of point {int(np.argmax(late)) + 1} is not that of a sample of the plan")
    if np.any(np.diff(samples) <= 0):
        raise ValueError(f"point {int(np.argmax(np.diff(samples) <= 0)) + 2} is not later than the one before")
    missing = sorted({0, *plan.stops, len(plan.time) - 1} - set(samples.tolist()))
    if missing:
        raise ValueError(f"the start, the end or a stop is missing: t = {factor * plan.time[missing[0]]:.4f} s")
    return samples, factor


def _model_defect(text: str, folder: Path, problem: Problem, texts: Sequence[str]) -> str:
    """Return the first difference of a robot model or its meshes from the problem, in words; empty if they agree.

    Args:
        text: text of the robot model (URDF or MJCF).
        folder: folder of the robot model.
        problem: the problem.
        texts: all valid robot models, with and without obstacles, with all revolute joints or only bending ones.

    Raises:
        ValueError: the text cannot be read as a robot model.
    """
    defect = "" if text in texts else _difference(_elements(text), map(_elements, texts), NUMBER_TOLERANCE)
    return defect or next(mesh_defects(folder, text, problem), "")


def _elements(text: str) -> list[str]:
    """Return the elements of an XML text in canonical form, one line per tag.

    Raises:
        ValueError: the text is not XML, or has declarations or instructions.
    """
    # Descriptions need no declarations, and entities could expand a short text without bound.
    if "<!" in text.replace("<!--", "") or "<?" in DECLARATION.sub("", text, count=1):
        raise ValueError("it has declarations or processing instructions, which a robot description does not need")
    try:
        return ET.canonicalize(text, strip_text=True).replace(">", ">\n").splitlines()
    except ET.ParseError as error:
        raise ValueError(f"not valid XML: {error}") from None


def _difference(lines: Sequence[str], variants: Iterable[Sequence[str]], tolerance: float) -> str:
    """Return the first difference between a text and the closest of several variants, in words; empty if they agree.

    The closest variant is the one with the most leading lines in common.

    Args:
        lines: lines of the text.
        variants: lines of each valid text.
        tolerance: allowed relative difference of numbers.
    """
    farthest, said = -1, ""
    for wanted in variants:
        alike = sum(1 for _ in takewhile(lambda pair: _are_alike(*pair, tolerance), zip(lines, wanted, strict=False)))
        if alike == len(lines) == len(wanted):
            return ""
        if alike > farthest:
            ours, theirs = (each[alike].strip()[:100] if alike < len(each) else "" for each in (lines, wanted))
            farthest, said = alike, f"line {alike + 1} is {ours!r}; expected {theirs!r}"
    return said


def _are_alike(found: str, wanted: str, tolerance: float) -> bool:
    """Return whether two lines agree: numbers to a relative tolerance, indentation exactly, other text up to blanks."""
    if found == wanted:
        return True
    ours, theirs = NUMBER.split(found), NUMBER.split(wanted)
    indents = [len(line) - len(line.lstrip()) for line in (found, wanted)]
    if len(ours) != len(theirs) or indents[0] != indents[1]:
        return False
    if any(one.split() != other.split() for one, other in zip(ours[::2], theirs[::2], strict=True)):
        return False
    numbers = np.array([ours[1::2], theirs[1::2]], dtype=np.float64)
    return bool(np.all(np.abs(numbers[0] - numbers[1]) <= tolerance * np.abs(numbers[1]) + ZERO))


NAME = "record against motion"
_OF_MOTION = ("wanted_gap", "clearance", "reach", "nearest", "start", "stops", "goal", "short")
"""Keys of the clearance record that follow from the motion alone; the attainable clearance and its price come from
planning."""
_OF_PLACES = ("gap", "wanted")
"""Keys compared for a place of minimum clearance. Bodies and time are not compared, since of several places of equal
clearance the record may name any."""
_OF_MESHES = ("obstacle", "kept", "sha256", "triangles", "closed")
"""Keys compared for a mesh; the path of the original file is no longer known."""


def record_data_check(
    record: Mapping[str, object],
    problem: Problem,
    trajectory: JointTrajectory,
    room: ClearanceRecord,
    left_out: Sequence[str],
) -> Check:
    """Return the check that the record in ``solution.json`` agrees with the motion of the plan.

    A missing entry is not a defect, since it cannot mislead anybody.

    Args:
        record: the whole record.
        problem: the problem in the record.
        trajectory: the motion, already verified.
        room: clearance of the motion, measured again.
        left_out: names of the properties that were not checked, determined again.
    """
    wanted: dict[str, object] = {
        "method": problem.planner.method,
        "seed": problem.planner.seed,
        "not_checked": list(left_out),
        "room": {name: _of_places(value) for name, value in clearance_data(room).items() if name in _OF_MOTION},
    }
    if problem.dimension == 3:
        wanted["goal"] = goal_data(goal_errors(problem, trajectory.positions[-1]))
        wanted["meshes"] = [{name: mesh[name] for name in _OF_MESHES} for mesh in mesh_data(problem)]
    # Least gaps are known only to the report resolution; everything else is far more accurate.
    allowed = DEFAULT_VERIFICATION.for_problem(problem).report_resolution
    wrong = [
        path for name, value in wanted.items() if name in record for path in _off(record[name], value, name, allowed)
    ]
    where = ", ".join(wrong[:5]) if wrong else f"{len(wanted)} agree"
    return Check(NAME, float(len(wrong)), 0.0, "that differ", where, passed=not wrong)


def _of_places(value: object) -> object:
    """Return an entry of the clearance record with only the keys ``_OF_PLACES`` of places of minimum clearance."""
    if isinstance(value, Mapping):
        if "nearest" in value:
            return {"nearest": _of_places(value["nearest"])}
        return {name: value[name] for name in _OF_PLACES}
    return [_of_places(each) for each in value] if isinstance(value, list) else value


def _off(found: object, wanted: object, path: str, allowed: float) -> Iterator[str]:
    """Yield the dotted path of each entry of a record that differs from the expected one; additional keys are allowed.

    Args:
        found: value in the record.
        wanted: expected value.
        path: dotted path of the value.
        allowed: allowed absolute difference of numbers.
    """
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
    # Python's True equals 1 and False equals 0, but a boolean must not match a number.
    return found == (None if isinstance(wanted, float) else wanted) and isinstance(found, bool) == isinstance(
        wanted, bool
    )
