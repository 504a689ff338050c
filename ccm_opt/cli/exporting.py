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
from ccm_opt.io.folder import ARRAYS, model_meshes, model_texts
from ccm_opt.io.glb import motion_glb
from ccm_opt.io.reading_back import load_any_problem, load_motion, read_arrays
from ccm_opt.io.record_file import recorded_results
from ccm_opt.io.trajectory_text import trajectory_texts
from ccm_opt.io.urdf import MESHES, URDF_MESHES
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
        meshes = URDF_MESHES if options.out is None else f"{options.out.name}{MESHES}"
        texts = model_texts(problem, obstacles=options.scene, bends_only=bends_only, meshes=meshes)
        text = texts["arm.urdf" if options.kind == "urdf" else "arm.mjcf.xml"]
        # MJCF of the plane has its meshes in itself.
        beside = options.scene and (options.kind == "urdf" or isinstance(problem, SpaceProblem))
        return {"": text.encode()} | (model_meshes(problem, meshes) if beside else {})
    motion = load_motion(folder, problem.arm)  # refuses what is no plan of this arm
    if options.kind == "npz":
        arrays = read_arrays(folder / ARRAYS)
        return {"": arrays_npz(bends_of_arrays(arrays) if bends_only else arrays)}
    if options.kind == "glb":
        return {"": motion_glb(problem, motion.trajectory)}
    points = controller_points(problem, motion.trajectory, motion.joints, recorded_results(folder).checks)
    csv, yaml = trajectory_texts(points, bends_only=bends_only, effort=options.effort)
    return {"": (csv if options.kind == "csv" else yaml).encode()}


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
