"""The files of the output folder, what each is called, and which places they may be written to."""

import os
import sys
from collections.abc import Callable, Mapping
from pathlib import Path

from ccm_opt.errors import ProblemError
from ccm_opt.files.export.arrays_npz import arrays_npz, solution_arrays
from ccm_opt.files.export.controller_points import controller_points
from ccm_opt.files.export.folder_swap import put_in_place
from ccm_opt.files.export.mjcf import mjcf_text
from ccm_opt.files.export.scene_solids import solid_scene
from ccm_opt.files.export.scene_urdf import URDF_MESHES, scene_meshes
from ccm_opt.files.export.solution_json import solution_json
from ccm_opt.files.export.space_mjcf import space_mjcf
from ccm_opt.files.export.space_scene import KEPT_MESHES, kept_meshes, named_bodies, space_meshes
from ccm_opt.files.export.space_urdf import space_urdf
from ccm_opt.files.export.trajectory_text import trajectory_texts
from ccm_opt.files.export.urdf import urdf_text
from ccm_opt.space.problem import AnyProblem, SpaceProblem
from ccm_opt.space.space_solution import AnySolution

RECORD = "solution.json"
"""Always there; why there is no plan stands here too."""
ARRAYS = "solution.npz"
TEXTS = (RECORD, "trajectory.csv", "trajectory.yaml", "arm.urdf", "arm.mjcf.xml")
FIGURES = ("plan", "curves", "steps", "links", "space")
"""Still pictures of a plan, each of which may have one of several formats."""
PICTURES = (
    *(f"{name}.{kind}" for name in FIGURES for kind in ("png", "svg", "pdf")),
    "motion.gif",
    "motion.mp4",
    "report.html",
    "simulation.png",
)
POSE_RECORD = "pose.json"
"""Of the folder of a pose; always there."""
POSE_ARRAYS = "pose.npz"
POSE_FILES = (POSE_RECORD, POSE_ARRAYS, "pose.png")
REACH_RECORD = "reach.json"
"""Of the folder of a map of reach; always there."""
REACH_FILES = (REACH_RECORD, "reach.npz", "reach.png")
PARETO_RECORD = "pareto.json"
PARETO_FILES = (PARETO_RECORD, "pareto.png", "pareto")
"""Beside the recommended one of several plans; the last is a folder with a folder for each plan."""
TOLERANCE_FILES = ("tolerance.json", "tolerance.png")
"""What ``ccm-opt tolerance`` writes beside a plan; a new plan takes them away."""
WRITTEN_FILES = frozenset(
    (*TEXTS, ARRAYS, *PICTURES, *POSE_FILES, *REACH_FILES, *PARETO_FILES, *TOLERANCE_FILES, URDF_MESHES, KEPT_MESHES)
)
"""Files and folders that a run writes; anything else in an old folder is the user's and is kept."""


def write_solution(solution: AnySolution, out: Path, pictures: Mapping[str, bytes] | None = None) -> Path:
    """Write the folder of a solved problem.

    Args:
        solution: the verified plan.
        out: the directory that holds the folder; it is made when it is not there.
        pictures: content of pictures by file name.

    Returns:
        The folder, ``out / <problem's name>``.

    Raises:
        ProblemError: when the folder cannot be written, or another folder is in its place.
    """
    return write_folder(out / solution.problem.name, {**solution_files(solution), **(pictures or {})})


def solution_files(solution: AnySolution) -> dict[str, bytes]:
    """Content of every file of a solved problem but the pictures, by file name."""
    files = {name: text.encode() for name, text in solution_texts(solution).items()}
    return {**files, ARRAYS: arrays_npz(solution_arrays(solution)), **_mesh_files(solution.problem)}


def _mesh_files(problem: AnyProblem) -> dict[str, bytes]:
    """Meshes of the URDF, and of a problem in space those that it was read with."""
    if isinstance(problem, SpaceProblem):
        return {**space_meshes(named_bodies(problem), URDF_MESHES), **kept_meshes(problem)}
    return scene_meshes(solid_scene(problem.workspace, problem.arm), URDF_MESHES)


def solution_texts(solution: AnySolution) -> dict[str, str]:
    """Text of every text file of a solved problem, by file name."""
    problem = solution.problem
    points = controller_points(problem, solution.trajectory, solution.joints, solution.checks)
    csv, yaml = trajectory_texts(points)
    return {
        RECORD: solution_json(solution),
        "trajectory.csv": csv,
        "trajectory.yaml": yaml,
        **model_texts(problem),
    }


def model_texts(problem: AnyProblem, *, obstacles: bool = True, bends_only: bool = False) -> dict[str, str]:
    """Descriptions of a problem's arm and obstacles for other programs, by file name."""
    if isinstance(problem, SpaceProblem):
        bodies = named_bodies(problem) if obstacles else ()
        return {
            "arm.urdf": space_urdf(problem, bodies, URDF_MESHES, bends_only=bends_only),
            "arm.mjcf.xml": space_mjcf(problem, bodies, URDF_MESHES, bends_only=bends_only),
        }
    scene = solid_scene(problem.workspace, problem.arm) if obstacles else None
    gravity = problem.simulation.gravity
    return {
        "arm.urdf": urdf_text(problem.arm, problem.name, problem.limits, scene, bends_only=bends_only),
        "arm.mjcf.xml": mjcf_text(problem.arm, problem.name, gravity, scene, bends_only=bends_only),
    }


def check_target(target: Path, record: str = RECORD) -> None:
    """Refuse a place where a folder could not be written, before any work is done for it; writes nothing.

    Args:
        target: the folder.
        record: name of the record by which a folder of an earlier run of the same kind is known.

    Raises:
        ProblemError: when something else is in the place, or nothing can be written there.
    """
    try:
        os.fsencode(target)
    except UnicodeEncodeError:
        raise ProblemError(
            f"cannot write a folder of the name {target.name!a}: file names here are in "
            f"{sys.getfilesystemencoding()}; set PYTHONUTF8=1, or give the problem another name"
        ) from None
    if target.is_symlink() or (target.exists() and not target.is_dir()):
        raise ProblemError(f"cannot write {target}: something that is not a folder has that name; choose another --out")
    if target.is_dir() and any(target.iterdir()) and not (target / record).is_file():
        raise ProblemError(f"cannot write {target}: it is a folder of something else; choose another --out or clear it")
    # Parents that are missing will be made, in the nearest one that exists.
    nearest = next((parent for parent in target.absolute().parents if parent.exists()), Path("/"))
    if not nearest.is_dir() or not os.access(nearest, os.W_OK | os.X_OK):
        raise ProblemError(f"cannot write {target}: {nearest} is not a writable folder; choose another --out")


def write_folder(
    target: Path,
    files: Mapping[str, bytes],
    record: str = RECORD,
    *,
    beside: Callable[[Path], Path] = Path,
) -> Path:
    """Put a folder with these files in its place; a folder of an earlier run gives way, the user's files in it stay.

    Args:
        target: the folder.
        files: content by file name; a name with slashes lies in folders of the folder.
        record: name of the record of this kind of folder, see ``check_target``.
        beside: another place for the folder, where that is to be left alone; asked when nobody else writes there.

    Returns:
        The folder.

    Raises:
        ProblemError: when it cannot be written; then the old folder, if any, is as it was.
    """

    def chosen(wanted: Path) -> Path:
        place = beside(wanted)
        check_target(place, record)
        return place

    try:
        return put_in_place(target, files, WRITTEN_FILES, chosen)
    except OSError as error:
        raise ProblemError(f"cannot write {target}: {error.strerror or error}; choose another --out") from error
