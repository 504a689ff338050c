"""The record of why there is no plan or no pose: in the place of the result, or beside an earlier one, which stays."""

from collections.abc import Mapping
from functools import partial
from pathlib import Path

from ccm_opt.errors import Diagnosis
from ccm_opt.files.export.earlier_results import FAILED, place_beside
from ccm_opt.files.export.folder import POSE_RECORD, RECORD, write_folder
from ccm_opt.files.export.pose_json import pose_failure_json
from ccm_opt.files.export.solution_json import failure_json
from ccm_opt.files.export.space_pose_files import space_pose_failure_json
from ccm_opt.files.export.space_scene import kept_meshes
from ccm_opt.space.problem import AnyProblem, SpaceProblem


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
