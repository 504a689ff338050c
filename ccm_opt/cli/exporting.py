"""``ccm-opt export``: the arm, its surroundings or the motion of a written plan as one file, for other programs."""

import sys
from dataclasses import dataclass
from pathlib import Path

from ccm_opt.cli.choices import ExportFormat
from ccm_opt.cli.outcome import SOLVED, print_result, run_all
from ccm_opt.cli.output import output
from ccm_opt.core.files import put_file
from ccm_opt.errors import ProblemError
from ccm_opt.io.arrays_npz import arrays_npz, bends_of_arrays
from ccm_opt.io.controller_points import controller_points
from ccm_opt.io.folder import ARRAYS
from ccm_opt.io.glb import motion_glb, space_motion_glb
from ccm_opt.io.mjcf import mjcf_text, space_mjcf
from ccm_opt.io.reading_back import load_any_problem, load_motion, read_arrays
from ccm_opt.io.record_file import recorded_results
from ccm_opt.io.scene_solids import solid_scene
from ccm_opt.io.space_scene import named_bodies, space_meshes, space_urdf
from ccm_opt.io.trajectory_text import trajectory_texts
from ccm_opt.io.urdf import MESHES, URDF_MESHES, scene_meshes, urdf_text
from ccm_opt.problem import Problem
from ccm_opt.problem.space_problem import SpaceProblem

BINARY = ("npz", "glb")
"""Formats that are no text, and have to go into a file."""


@dataclass(frozen=True)
class ExportOptions:
    """What the command line asks for.

    Attributes:
        kind: the format.
        out: the file; standard output when None, for texts alone.
        bends_only: whether the revolutes that a plane motion leaves alone are left out.
        scene: whether obstacles are written with the arm.
        effort: whether a ROS message has efforts.
    """

    kind: ExportFormat
    out: Path | None = None
    bends_only: bool = False
    scene: bool = True
    effort: bool = False


def export_folder(folder: Path, options: ExportOptions) -> int:
    """Write one format of a written plan.

    Args:
        folder: an output folder of ``ccm-opt solve``.
        options: the options.

    Returns:
        The exit code.
    """
    return run_all([folder], lambda item: _export(item, options))


def exported_files(folder: Path, options: ExportOptions) -> dict[str, bytes]:
    """The file of a format, under the name ``""``, and the meshes beside it by their names, made anew from the folder.

    Raises:
        ProblemError: for an unreadable folder.
    """
    problem = load_any_problem(folder)
    bends_only = options.bends_only
    if options.kind in {"urdf", "mjcf"}:
        return _space_model(problem, options) if isinstance(problem, SpaceProblem) else _model(problem, options)
    motion = load_motion(folder, problem.arm)  # refuses what is no plan of this arm
    if options.kind == "npz":
        arrays = read_arrays(folder / ARRAYS)
        return {"": arrays_npz(bends_of_arrays(arrays) if bends_only else arrays)}
    if options.kind == "glb":
        if isinstance(problem, SpaceProblem):
            return {"": space_motion_glb(problem, motion.trajectory)}
        return {"": motion_glb(problem, motion.trajectory)}
    points = controller_points(problem, motion.trajectory, motion.joints, recorded_results(folder).checks)
    csv, yaml = trajectory_texts(points, bends_only=bends_only, effort=options.effort)
    return {"": (csv if options.kind == "csv" else yaml).encode()}


def _model(problem: Problem, options: ExportOptions) -> dict[str, bytes]:
    """URDF or MJCF of an arm in the plane, under the name "", and the meshes beside it."""
    arm = problem.arm
    scene = solid_scene(problem.workspace, arm) if options.scene else None
    if options.kind == "mjcf":
        gravity = problem.simulation.gravity
        return {"": mjcf_text(arm, problem.name, gravity, scene, bends_only=options.bends_only).encode()}
    meshes = _mesh_folder(options)
    text = urdf_text(arm, problem.name, problem.limits, scene, meshes, bends_only=options.bends_only)
    return {"": text.encode()} | ({} if scene is None else scene_meshes(scene, meshes))


def _space_model(problem: SpaceProblem, options: ExportOptions) -> dict[str, bytes]:
    """The same of an arm in space; in MJCF too meshes are files beside it."""
    bodies = named_bodies(problem) if options.scene else ()
    meshes = _mesh_folder(options)
    write = space_urdf if options.kind == "urdf" else space_mjcf
    text = write(problem, bodies, meshes, bends_only=options.bends_only)
    return {"": text.encode()} | space_meshes(bodies, meshes)


def _mesh_folder(options: ExportOptions) -> str:
    return URDF_MESHES if options.out is None else f"{options.out.name}{MESHES}"


def _export(folder: Path, options: ExportOptions) -> int:
    out = options.out
    if out is None and options.kind in BINARY:
        raise ProblemError(f"{options.kind} is no text; name the file to write with --out")
    files = exported_files(folder, options)
    if out is None:
        text = files[""].decode()
        return print_result(lambda: sys.stdout.write(text), SOLVED, lambda: {"status": "exported", "text": text})
    try:
        for name, content in files.items():
            place = out.parent / name if name else out
            place.parent.mkdir(parents=True, exist_ok=True)
            put_file(place, content)
    except OSError as error:
        raise ProblemError(f"cannot write {out}: {error.strerror or error}; choose another --out") from error
    output().note({"status": "exported", "file": str(out)})
    return SOLVED
