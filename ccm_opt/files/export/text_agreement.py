"""Whether the text files of an output folder say what its arrays say: table, ROS message, descriptions of the arm."""

import json
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import lru_cache, partial
from itertools import repeat
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np

from ccm_opt.files.export.folder import model_texts
from ccm_opt.files.export.mesh_agreement import mesh_defects
from ccm_opt.files.export.trajectory_text import bending_joints, trajectory_columns
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.ground.plain_file import read_plain
from ccm_opt.solution import Check, JointStates, JointTrajectory
from ccm_opt.space.problem import AnyProblem

TEXT_TOLERANCE = 5.1e-12
"""Share by which a number of the table or the message may differ: twelve digits are written, and half of the last."""
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
ROS_FIELDS = ("positions", "velocities", "accelerations", "effort")
"""Lists of every point of a ROS message, in the order of the quantities of the table."""


def checks_of_texts(folder: Path, problem: AnyProblem, trajectory: JointTrajectory, joints: JointStates) -> list[Check]:
    """One check for each text file that is there; whoever deletes one loses it, and misleads nobody.

    Args:
        folder: an output folder.
        problem: whose arm is described.
        trajectory: the motion in the folder's arrays.
        joints: the same for all drives.
    """
    readers = {
        "trajectory.csv": partial(_table_defects, time=trajectory.time),
        "trajectory.yaml": partial(_message_defects, time=trajectory.time),
    }
    described = lru_cache(partial(model_texts, problem))
    numbers = len(trajectory.time) * (len(ROS_FIELDS) * (len(joints.names) + trajectory.positions.shape[1]) + 1)
    found = []
    for name in NAMES:
        if not (folder / name).exists():
            continue
        variants: Iterator[Callable[[str], Iterator[str]]]
        if name in readers:
            of_joints = (
                trajectory_columns(trajectory, some)
                for some in (joints, bending_joints(joints, trajectory.coordinates))
            )
            variants = (partial(readers[name], names=names, tables=tables) for names, tables in of_joints)
            length = LONGEST_NUMBER * numbers
        else:
            meshes = partial(mesh_defects, folder, problem=problem)
            length = len(described(obstacles=True, bends_only=False)[name])
            variants = (partial(_model_defects, wanted=text, meshes=meshes) for text in _descriptions(described, name))
        found.append(_check(folder / name, variants, max(MOST_TIMES_LONGER * length, LEAST_BYTES)))
    return found


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


def _numbers(text: str) -> FloatArray:
    """Rows of numbers between commas; of one length, else ValueError."""
    lines = text.splitlines()
    if not all(lines):
        raise ValueError("a row has no numbers")
    return np.loadtxt(lines, delimiter=",", comments=None, ndmin=2)


def _table_defects(
    text: str,
    time: FloatArray,
    names: Mapping[str, tuple[str, ...]],
    tables: Mapping[str, FloatArray],
) -> Iterator[str]:
    """What of ``trajectory.csv`` is otherwise than the arrays."""
    head, _, body = text.partition("\n")
    columns = [column for quantity in tables for column in names[quantity]]
    if head.rstrip("\r").split(",") != ["time", *columns]:
        yield "its columns are not those of the arm's joints"
        return
    rows = [row.partition(",") for row in body.splitlines()]
    if len(rows) != len(time):
        yield f"it has {len(rows)} rows for {len(time)} samples"
        return
    times = np.array([float(first) for first, _, _ in rows])
    yield from _differing(times[:, None], time[:, None], ["time"])
    yield from _differing(_numbers("\n".join([rest for _, _, rest in rows])), _side_by_side(tables), columns)


def _message_defects(
    text: str,
    time: FloatArray,
    names: Mapping[str, tuple[str, ...]],
    tables: Mapping[str, FloatArray],
) -> Iterator[str]:
    """What of ``trajectory.yaml`` is otherwise than the arrays."""
    lines = [line.rstrip() for line in text.splitlines() if line.strip() and not line.lstrip().startswith("#")]
    joints = [column.rpartition("_")[0] for column in next(iter(names.values()))]
    field, _, value = lines[0].partition(": ") if lines else ("", "", "")
    if field != "joint_names" or json.loads(value) != joints:
        yield "its joint_names are not those of the arm"
        return
    size = 1 + len(ROS_FIELDS)
    points = [lines[k : k + size] for k in range(2, len(lines), size)]
    if lines[1:2] != ["points:"] or len(points) != len(time):
        yield f"it has {len(points)} points for {len(time)} samples, or none"
        return
    # Whatever else stood in it, such as a second list of points, other programs might take for the motion.
    found = [_point(point) for point in points]
    strange = next((k for k, point in enumerate(found) if point is None), None)
    if strange is not None:
        yield f"point {strange + 1} is not made of {', '.join(('time_from_start', *ROS_FIELDS))}, each once"
        return
    values = [point for point in found if point is not None]
    seconds = np.array([point["time_from_start"].split(",") for point in values], dtype=np.float64)
    # Nanoseconds are whole numbers, so that each is off by half of one at most.
    late = np.abs(seconds @ (1.0, 1e-9) - time)
    if np.max(late) > 1e-9:
        yield f"time_from_start of point {int(np.argmax(late)) + 1} is not that of its sample"
    # One list too long would else make up for one that is too short.
    if any(point[field].count(",") != len(joints) - 1 for point in values for field in ROS_FIELDS):
        yield "it has lists that are not as long as the arm has joints"
        return
    rows = [",".join([point[field] for field in ROS_FIELDS]) for point in values]
    columns = [column for quantity in tables for column in names[quantity]]
    yield from _differing(_numbers("\n".join(rows)), _side_by_side(tables), columns)


def _point(lines: Sequence[str]) -> Mapping[str, str] | None:
    """The numbers of a point of a message, by its fields; None where it is made otherwise than points are."""
    point = {}
    for line, indent in zip(lines, ("- ", *repeat("  ", len(ROS_FIELDS))), strict=False):
        field, _, value = line.removeprefix(indent).partition(": ")
        match = (STAMP if field == "time_from_start" else LIST).fullmatch(value)
        if not line.startswith(indent) or match is None:
            return None
        point[field] = ",".join(match.groups())
    return point if point.keys() == {"time_from_start", *ROS_FIELDS} else None


def _side_by_side(tables: Mapping[str, FloatArray]) -> FloatArray:
    return np.column_stack(tuple(tables.values()))


def _differing(rows: FloatArray, columns: FloatArray, names: Sequence[str]) -> Iterator[str]:
    """The first value that differs from the arrays, if one does."""
    if rows.shape != columns.shape:
        yield f"it has {rows.shape[1]} numbers a sample, not {columns.shape[1]}"
        return
    off = np.abs(rows - columns)
    # What is no number, or infinite, differs: it is not less than any bound.
    wrong = ~(off <= TEXT_TOLERANCE * np.abs(columns) + np.finfo(np.float64).tiny)
    if np.any(wrong):
        sample, column = np.argwhere(wrong)[0]
        found = rows[sample, column]
        yield f"{names[column]} of sample {sample + 1} is {found:.12g}, not {columns[sample, column]:.12g}"


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
