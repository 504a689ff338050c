"""The files ``trajectory.csv``, for spreadsheets, and ``trajectory.yaml``, in the shape of a ROS message."""

import json
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from ccm_opt.files.export.arm_description import FEED
from ccm_opt.files.export.number_writing import number_rows
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.jointed.coordinates import Coordinates
from ccm_opt.solution import JointStates, JointTrajectory

_QUANTITIES = ("angle", "velocity", "acceleration", "torque")
_FEED_QUANTITIES = ("position", "velocity", "acceleration", "force")
_ROS_FIELDS = ("positions", "velocities", "accelerations", "effort")


def trajectory_texts(trajectory: JointTrajectory, joints: JointStates, *, bends_only: bool = False) -> tuple[str, str]:
    """The motion of all revolutes as CSV and as YAML; SI units, radians.

    Both have the same numbers, of twelve digits, and formatting them is most of the work: it is done once. Every number
    has a point, whole ones too: the fields of ROS messages take floats alone, and YAML takes ``1e-05`` for a text.

    Args:
        trajectory: gives the time.
        joints: gives names, angles, velocities, accelerations, torques.
        bends_only: whether the revolutes that turn out of the plane, or about the link, are left out.

    Returns:
        The text of ``trajectory.csv``: ``time`` and a column ``<joint>_<quantity>`` for every joint and quantity; and
        of ``trajectory.yaml``: ``joint_names`` and ``points`` as in ROS 2 ``trajectory_msgs/JointTrajectory``. A feed
        axis is the first joint, ``feed``, with the columns ``feed_position``, …, ``feed_force`` [m, N].
    """
    names, tables = _tables(trajectory, bending_joints(joints, trajectory.coordinates) if bends_only else joints)
    columns = [number_rows(table) for table in tables]
    times = trajectory.time.tolist()
    return "\n".join(_csv(times, names, columns)), "\n".join(_yaml(times, names, columns))


def trajectory_columns(
    trajectory: JointTrajectory, joints: JointStates
) -> tuple[dict[str, tuple[str, ...]], dict[str, FloatArray]]:
    """Headings of the table's columns, and their numbers, of shape (T, joints), by quantity and in its order."""
    names, tables = _tables(trajectory, joints)
    headings = {quantity: tuple(_column(name, k) for name in names) for k, quantity in enumerate(_QUANTITIES)}
    return headings, dict(zip(_QUANTITIES, tables, strict=True))


def _tables(trajectory: JointTrajectory, joints: JointStates) -> tuple[tuple[str, ...], list[FloatArray]]:
    """Names of the joints, and their positions, velocities, accelerations and efforts; the feed axis is the first."""
    tables = [joints.angles, joints.velocities, joints.accelerations, joints.torques]
    base = [
        trajectory.base_positions,
        trajectory.base_velocities,
        trajectory.base_accelerations,
        joints.base_forces,
    ]
    names = (*trajectory.coordinates.base_names, *joints.names)
    return names, [np.column_stack(pair) for pair in zip(base, tables, strict=True)]


def bending_joints(joints: JointStates, coordinates: Coordinates) -> JointStates:
    """The revolutes that bend the arm alone: the second of every ball in the plane, the first and second in space."""
    bending = coordinates.drive_numbers[coordinates.bends]
    return replace(
        joints,
        names=tuple(joints.names[drive] for drive in bending),
        angles=joints.angles[:, bending],
        velocities=joints.velocities[:, bending],
        accelerations=joints.accelerations[:, bending],
        torques=joints.torques[:, bending],
    )


def _csv(times: list[float], names: tuple[str, ...], columns: list[list[str]]) -> Iterator[str]:
    headings = [_column(name, place) for place in range(len(_QUANTITIES)) for name in names]
    yield ",".join(["time", *headings])
    for time, *rows in zip(times, *columns, strict=True):
        yield ",".join([f"{time:.12g}", *rows])
    yield ""


def _column(name: str, place: int) -> str:
    quantities = _FEED_QUANTITIES if name == FEED else _QUANTITIES
    return f"{name}_{quantities[place]}"


def _yaml(times: list[float], names: tuple[str, ...], columns: list[list[str]]) -> Iterator[str]:
    yield f"joint_names: {json.dumps(list(names))}"
    yield "points:"
    for time, *rows in zip(times, *columns, strict=True):
        seconds, nanoseconds = divmod(round(time * 1e9), 1_000_000_000)
        yield f"- time_from_start: {{sec: {seconds}, nanosec: {nanoseconds}}}"
        yield from (f"  {field}: [{row}]" for field, row in zip(_ROS_FIELDS, rows, strict=True))
    yield ""
