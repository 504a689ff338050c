"""Whether a record says of room, goal, meshes and gaps in its checks what its problem and its motion say."""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from ccm_opt.files.export.room_json import room_data
from ccm_opt.files.export.solution_json import goal_data
from ccm_opt.files.export.space_record import mesh_data
from ccm_opt.solution import Check, JointTrajectory, RoomRecord
from ccm_opt.space.problem import AnyProblem, SpaceProblem
from ccm_opt.space.space_solution import goal_errors
from ccm_opt.verification.verification_settings import DEFAULT_VERIFICATION

NAME = "record against motion"
_OF_MOTION = ("wanted_gap", "clearance", "reach", "nearest", "start", "stops", "goal", "short")
"""What of the room follows from the motion; what would have been possible, and what it costs, was found in planning."""
_OF_PLACES = ("gap", "wanted")
"""What is held of a place with little room; of several that are alike any may be named."""
_OF_MESHES = ("obstacle", "kept", "sha256", "triangles", "closed")
"""What is held of a mesh; where it was copied from is not known any more."""


def check_of_data(
    record: Mapping[str, object],
    problem: AnyProblem,
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
    if isinstance(problem, SpaceProblem):
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
