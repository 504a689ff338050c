"""Folders of problems without a plan."""

import itertools
from collections.abc import Mapping
from functools import partial
from pathlib import Path

from ccm_opt.errors import Diagnosis
from ccm_opt.io.folder import ARRAYS, POSE_ARRAYS, POSE_RECORD, RECORD, write_folder
from ccm_opt.io.solution_json import failure_json, pose_failure_json
from ccm_opt.io.space_pose_files import space_pose_failure_json
from ccm_opt.io.space_scene import kept_meshes
from ccm_opt.problem.space_problem import AnyProblem, SpaceProblem

FAILED = ".failed"
"""Added to the name of a folder whose earlier result stays, for the record of why there is no new one."""
UNFINISHED = ".unfinished"
"""The same for a verified plan whose simulation or pictures were cut short."""


def place_beside(target: Path, ending: str) -> Path:
    """The folder itself, or, where it holds an earlier result, one of nearly the same name beside it.

    Args:
        target: the folder of the result.
        ending: added to its name; a number follows where a result is there too, or something that no run wrote.

    Returns:
        A folder that may be written: it is new, or holds the record of an earlier failure.
    """
    if not holds_result(target):
        return target
    names = (f"{target.name}{ending}" + (f"-{number}" if number > 1 else "") for number in itertools.count(1))
    return next(place for name in names if _may_be_written(place := target.with_name(name)))


def holds_result(folder: Path) -> bool:
    """Whether a folder holds a plan or a pose, which only another plan or pose may replace."""
    return any((folder / arrays).is_file() for arrays in (ARRAYS, POSE_ARRAYS))


def _may_be_written(place: Path) -> bool:
    if not place.exists():
        return not place.is_symlink()
    return place.is_dir() and any(place.glob("*.json")) and not holds_result(place)


def write_failure(
    problem: AnyProblem,
    status: str,
    diagnosis: Diagnosis,
    out: Path,
    timings: Mapping[str, float] | None = None,
    pictures: Mapping[str, bytes] | None = None,
) -> Path:
    """Write the folder of a problem without a plan: ``solution.json``, and pictures where there are any.

    Args:
        problem: what was asked.
        status: how the search ended.
        diagnosis: why there is no plan.
        out: the directory that holds the folder.
        timings: of the stages that ran [s].
        pictures: content of pictures by file name.

    Returns:
        The folder: ``out / <problem's name>``, or with ``.failed`` at its end where an earlier plan has that place.

    Raises:
        ProblemError: when the folder cannot be written, or another folder is in its place.
    """
    record = failure_json(problem, status, diagnosis, timings or {})
    # The problem in the record is read with the meshes beside it.
    meshes = kept_meshes(problem) if isinstance(problem, SpaceProblem) else {}
    files = {RECORD: record.encode(), **meshes, **(pictures or {})}
    return write_folder(out / problem.name, files, beside=_FAILED_PLACE)


def write_pose_failure(
    problem: AnyProblem, status: str, diagnosis: Diagnosis, out: Path, timings: Mapping[str, float]
) -> Path:
    """Write the folder of a problem at whose goal no pose was found: ``pose.json``, in space with the meshes.

    Args:
        problem: what was asked.
        status: how the search ended.
        diagnosis: why there is no pose.
        out: the directory that holds the folder.
        timings: of the stages that ran [s].

    Returns:
        The folder, chosen as for ``write_failure``.

    Raises:
        ProblemError: as for ``write_failure``.
    """
    if isinstance(problem, SpaceProblem):
        record = space_pose_failure_json(problem, status, diagnosis, timings)
        files = kept_meshes(problem)
    else:
        record = pose_failure_json(problem, status, diagnosis, timings)
        files = {}
    return write_folder(out / problem.name, {POSE_RECORD: record.encode(), **files}, POSE_RECORD, beside=_FAILED_PLACE)


_FAILED_PLACE = partial(place_beside, ending=FAILED)
