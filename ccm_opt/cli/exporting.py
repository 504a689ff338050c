"""``ccm-opt export``: the arm or the motion of a written plan as one file, for other programs."""

import sys
from pathlib import Path

from ccm_opt.cli.outcome import SOLVED, print_result, run_all
from ccm_opt.cli.output import output
from ccm_opt.errors import ProblemError
from ccm_opt.files.export.mjcf import mjcf_text
from ccm_opt.files.export.reading_back import load_motion, load_recorded_problem
from ccm_opt.files.export.trajectory_text import trajectory_texts
from ccm_opt.files.export.urdf import urdf_text
from ccm_opt.ground.whole_file import put_file


def export_folder(folder: Path, kind: str, out: Path | None) -> int:
    """Write one format of a written plan.

    Args:
        folder: an output folder of ``ccm-opt solve``.
        kind: one of ``EXPORT_FORMATS``.
        out: the file; standard output when None.

    Returns:
        The exit code.
    """
    return run_all([folder], lambda item: _export(item, kind, out))


def exported_text(folder: Path, kind: str) -> str:
    """The text of a format, made anew from the folder's record and arrays.

    Raises:
        ProblemError: for an unreadable folder.
    """
    problem = load_recorded_problem(folder)
    if kind == "urdf":
        return urdf_text(problem.arm, problem.name, problem.limits)
    if kind == "mjcf":
        return mjcf_text(problem.arm, problem.name, problem.simulation.gravity)
    motion = load_motion(folder, problem.arm)
    csv, yaml = trajectory_texts(motion.trajectory, motion.joints)
    return csv if kind == "csv" else yaml


def _export(folder: Path, kind: str, out: Path | None) -> int:
    text = exported_text(folder, kind)
    if out is None:
        return print_result(lambda: sys.stdout.write(text), SOLVED, lambda: {"status": "exported", "text": text})
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        put_file(out, text.encode())
    except OSError as error:
        raise ProblemError(f"cannot write {out}: {error.strerror or error}; choose another --out") from error
    output().note({"status": "exported", "file": str(out)})
    return SOLVED
