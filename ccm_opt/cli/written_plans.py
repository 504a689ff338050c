"""The commands ``check``, which verifies plans in output folders again, and ``export``, which converts them."""

import itertools
import sys
from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np

from ccm_opt.cli.outcome import NO_PLAN, SOLVED, print_result, run_all, warn
from ccm_opt.cli.output import ExportFormat, output
from ccm_opt.cli.tables import (
    checks_table,
    print_clearance,
    print_not_checked,
    print_tour,
    report_console,
    result_units,
)
from ccm_opt.core.errors import ProblemError
from ccm_opt.core.files import put_file_or_refuse
from ccm_opt.driver.clearance_over_time import clearance_over_time
from ccm_opt.ik.terms import Constraint, load_terms
from ccm_opt.io.controller_points import controller_points, trajectory_texts
from ccm_opt.io.folder import ARRAYS, model_meshes, model_texts
from ccm_opt.io.glb import motion_glb
from ccm_opt.io.reading_back import SavedMotion, load_any_problem, load_motion, load_posed, read_arrays
from ccm_opt.io.record_reading import recorded_results
from ccm_opt.io.records import arrays_npz, bend_arrays, clearance_data
from ccm_opt.io.robot_models import MESHES, URDF_MESHES
from ccm_opt.io.text_agreement import record_data_check, text_checks
from ccm_opt.problem import Problem
from ccm_opt.problem.solution import Check
from ccm_opt.verification.verifier import left_unchecked, verify
from ccm_opt.viz.checks_section import checks_in_words

MALFORMED = ("samples", "joint names")
"""Names of the only checks that the verifier makes for a malformed motion."""


def check_folders(folders: Sequence[Path], constraints: tuple[str, ...] = ()) -> int:
    """Verify the plan in every output folder again, from its files alone, and return the exit code.

    Args:
        folders: output folders of ``ccm-opt solve``.
        constraints: references to the user's constraints, each ``module:function`` or ``file.py:function``, which are
            checked for every plan.

    Returns:
        The exit code of the worst outcome; after a failure the other folders are still verified.
    """
    return run_all(folders, lambda folder: _check(folder, constraints))


def _check(folder: Path, constraints: tuple[str, ...]) -> int:
    posed, tour = load_posed(folder)
    motion = load_motion(folder, posed.arm)
    recorded = recorded_results(folder)
    plan_checks = verify(posed, motion.trajectory, motion.joints, tour=tour)
    problem = posed if tour is None else tour.visited
    of_terms = _constraint_checks(problem, motion, constraints) if constraints else ()
    # For a malformed motion the verifier stops after these checks, and nothing else can be checked either.
    whole = len(plan_checks) > len(MALFORMED)
    room = clearance_over_time(problem, motion.trajectory, problem.wanted_gap, plan_checks) if whole else None
    left_out = left_unchecked(problem, motion.trajectory) if room is not None else ()
    checks = (*plan_checks, *of_terms)
    if room is not None:
        from ccm_opt.driver.record_agreement import record_checks  # noqa: PLC0415 - loads the simulation

        # Everything else that the folder records about the motion is checked too.
        of_data = record_data_check(recorded.data, problem, motion.trajectory, room, left_out)
        of_texts = text_checks(folder, problem, motion.trajectory, motion.joints, plan_checks)
        checks = (*checks, *record_checks(problem, motion, recorded, plan_checks, room), of_data, *of_texts)
    passed = all(check.passed for check in checks)
    left_out = left_out if passed else ()
    verdict = "every check holds" if passed else "refused"
    # A refused motion's clearance is not reported by itself: the failed checks say it.
    room = room if passed else None
    # A folder holds the names of constraints only, not their expressions.
    now = {check.name.partition("constraint ")[2] for check in of_terms}
    unchecked = [name for name in recorded.constraints if name not in now]
    if unchecked:
        one = len(unchecked) == 1
        warn(
            f"{problem.name}: {len(unchecked)} constraint{' was' if one else 's were'} not checked: "
            f"{', '.join(map(repr, unchecked))}; give {'it' if one else 'them'} with --constraint"
        )

    def show() -> None:
        console = report_console()
        words = checks_in_words(checks, result_units(problem), problem.numbered_goals, in_space=problem.dimension == 3)
        shown_checks = [check for check in words if output().verbose or not check.of_itself or not check.passed]
        console.print(checks_table(f"{problem.name}: {verdict}", shown_checks))
        if len(shown_checks) < len(words):
            console.print(f"and {len(words) - len(shown_checks)} checks of the plan's consistency passed")
        print_clearance(console, room, result_units(problem))
        print_not_checked(console, left_out)
        print_tour(console, tour if passed else None)

    def data() -> dict[str, object]:
        return {
            "name": problem.name,
            "status": verdict,
            "checks": [{name: value for name, value in asdict(check).items() if name != "place"} for check in checks],
            "unchecked_constraints": unchecked,
            "not_checked": list(left_out),
            "room": None if room is None else clearance_data(room),
        }

    return print_result(show, SOLVED if passed else NO_PLAN, data)


def _constraint_checks(problem: Problem, motion: SavedMotion, references: tuple[str, ...]) -> tuple[Check, ...]:
    """Return the checks of the user's constraints on a plan read from a folder.

    For a plan with intermediate goals, there is one check for every constraint and leg, as when the plan was made.

    Raises:
        ProblemError: a constraint cannot be loaded, or cannot be checked from files alone.
    """
    from ccm_opt.driver.arguments import compiled_terms  # noqa: PLC0415 - loads casadi
    from ccm_opt.ik.term_checks import checks_without_path  # noqa: PLC0415 - likewise

    terms = compiled_terms(problem.arm, load_terms(references, Constraint), ())
    if terms is None:
        return ()
    whole = motion.trajectory
    ends = np.unique([0, *whole.stops, len(whole.time) - 1])
    found = []
    for leg, (first, last) in enumerate(itertools.pairwise(ends), start=1):
        piece = slice(int(first), int(last) + 1)
        trajectory = replace(
            whole,
            time=whole.time[piece],
            positions=whole.positions[piece],
            velocities=whole.velocities[piece],
            accelerations=whole.accelerations[piece],
            stops=(),
        )
        ending = f", goal {leg}" if len(ends) > 2 else ""
        checks = checks_without_path(terms, trajectory, motion.keyframes)
        found += [replace(check, name=f"{check.name}{ending}") for check in checks]
    return tuple(found)


BINARY = ("npz", "glb")
"""Binary export formats, which are not written to standard output."""


def export_folder(folder: Path, kind: ExportFormat, out: Path | None = None, **choices: bool) -> int:
    """Export the plan in an output folder in one format, and return the exit code.

    Args:
        folder: an output folder of ``ccm-opt solve``.
        kind: file format.
        out: output file; None for standard output, for text formats only.
        choices: options of ``exported_files``.

    Returns:
        The exit code, see ``outcome``.
    """

    def export(item: Path) -> int:
        if out is None and kind in BINARY:
            raise ProblemError(f"{kind} is a binary format; name the file to write with --out")
        files = exported_files(item, kind, out, **choices)
        if out is None:
            text = files[""].decode()
            return print_result(lambda: sys.stdout.write(text), SOLVED, lambda: {"status": "exported", "text": text})
        for name, content in files.items():
            put_file_or_refuse(out.parent / name if name else out, content, "choose another --out")
        output().note({"status": "exported", "file": str(out)})
        return SOLVED

    return run_all([folder], export)


def exported_files(
    folder: Path,
    kind: ExportFormat,
    out: Path | None = None,
    *,
    bends_only: bool = False,
    scene: bool = True,
    effort: bool = False,
) -> dict[str, bytes]:
    """Return the contents of exported files by name: ``""`` for the main file, and paths of mesh files next to it.

    Args:
        folder: an output folder of ``ccm-opt solve``.
        kind: file format.
        out: output file, after which the folder of mesh files is named; None for the default name.
        bends_only: whether to omit revolute joints that never bend the arm.
        scene: whether to export obstacles with the arm.
        effort: whether to include efforts in a ROS message.

    Raises:
        ProblemError: the folder is not readable.
    """
    problem = load_any_problem(folder)
    if kind in {"urdf", "mjcf"}:
        meshes = URDF_MESHES if out is None else f"{out.name}{MESHES}"
        texts = model_texts(problem, obstacles=scene, bends_only=bends_only, meshes=meshes)
        text = texts["arm.urdf" if kind == "urdf" else "arm.mjcf.xml"]
        # Planar MJCF embeds its meshes.
        beside = scene and (kind == "urdf" or problem.dimension == 3)
        return {"": text.encode()} | (model_meshes(problem, meshes) if beside else {})
    motion = load_motion(folder, problem.arm)  # refuses anything but a plan of this arm
    if kind == "npz":
        arrays = read_arrays(folder / ARRAYS)
        return {"": arrays_npz(bend_arrays(arrays) if bends_only else arrays)}
    if kind == "glb":
        return {"": motion_glb(problem, motion.trajectory)}
    points = controller_points(problem, motion.trajectory, motion.joints, recorded_results(folder).checks)
    csv, yaml = trajectory_texts(points, problem.arm, bends_only=bends_only, effort=effort)
    return {"": (csv if kind == "csv" else yaml).encode()}
