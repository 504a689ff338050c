"""The timed motion as text: ``trajectory.csv`` for spreadsheets, ``trajectory.yaml`` in the shape of a ROS message."""

import json
from collections.abc import Iterator

from ccm_opt.arrays import FloatArray
from ccm_opt.solution import JointStates, JointTrajectory

_QUANTITIES = ("angle", "velocity", "acceleration", "torque")
_ROS_FIELDS = ("positions", "velocities", "accelerations", "effort")


def trajectory_texts(trajectory: JointTrajectory, joints: JointStates) -> tuple[str, str]:
    """The motion of all revolutes as CSV and as YAML; SI units, radians.

    Both have the same numbers, of twelve digits, and formatting them is most of the work: it is done once.

    Args:
        trajectory: gives the time.
        joints: gives names, angles, velocities, accelerations, torques.

    Returns:
        The text of ``trajectory.csv``: ``time`` and a column ``<joint>_<quantity>`` for every joint and quantity; and
        of ``trajectory.yaml``: ``joint_names`` and ``points`` as in ROS 2 ``trajectory_msgs/JointTrajectory``.
    """
    tables = (joints.angles, joints.velocities, joints.accelerations, joints.torques)
    columns = [_rows(table) for table in tables]
    times = trajectory.time.tolist()
    return "\n".join(_csv(times, joints.names, columns)), "\n".join(_yaml(times, joints.names, columns))


def _rows(table: FloatArray) -> list[str]:
    """Every row of a table, its numbers joined by commas."""
    row = ",".join(["%.12g"] * table.shape[1])
    return [row % tuple(values) for values in table.tolist()]


def _csv(times: list[float], names: tuple[str, ...], columns: list[list[str]]) -> Iterator[str]:
    yield ",".join(["time", *(f"{name}_{quantity}" for quantity in _QUANTITIES for name in names)])
    for time, *rows in zip(times, *columns, strict=True):
        yield ",".join([f"{time:.12g}", *rows])
    yield ""


def _yaml(times: list[float], names: tuple[str, ...], columns: list[list[str]]) -> Iterator[str]:
    yield f"joint_names: {json.dumps(list(names))}"
    yield "points:"
    for time, *rows in zip(times, *columns, strict=True):
        seconds, nanoseconds = divmod(round(time * 1e9), 1_000_000_000)
        yield f"- time_from_start: {{sec: {seconds}, nanosec: {nanoseconds}}}"
        yield from (f"  {field}: [{row}]" for field, row in zip(_ROS_FIELDS, rows, strict=True))
    yield ""
