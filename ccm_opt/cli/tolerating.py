"""``ccm-opt tolerance``: the errors of the arm, its place, the room and its loads that a written plan survives."""

from collections.abc import Sequence
from pathlib import Path

from rich.markup import escape
from rich.table import Table

from ccm_opt.cli.outcome import SOLVED, print_result, run_all
from ccm_opt.cli.tables import columned_table, report_console, units_of
from ccm_opt.core.files import put_file
from ccm_opt.driver.verified_motion import check, failed_checks
from ccm_opt.errors import ProblemError, VerificationError
from ccm_opt.io.folder import TOLERANCE_FILES
from ccm_opt.io.reading_back import SavedMotion, load_any_problem, load_motion
from ccm_opt.io.solution_json import tolerance_data, tolerance_json
from ccm_opt.problem.space_problem import AnyProblem, SpaceProblem
from ccm_opt.solution import SurvivedError
from ccm_opt.viz.room_section import survived_in_words


def tolerance_of_folders(folders: Sequence[Path], *, simulated: bool, pictures: bool) -> int:
    """Look at every folder; all are tried.

    Args:
        folders: output folders of ``ccm-opt solve``.
        simulated: whether payload and friction are sought as well.
        pictures: whether to draw ``tolerance.png`` into the folder.

    Returns:
        The exit code: 3 when a folder holds no plan that passes every check.
    """
    return run_all(folders, lambda folder: _look_at(folder, simulated=simulated, pictures=pictures))


def _look_at(folder: Path, *, simulated: bool, pictures: bool) -> int:
    problem = load_any_problem(folder)
    motion = load_motion(folder, problem.arm)
    # The certificate takes for granted that the plan itself touches nothing.
    if failures := failed_checks(check(problem, motion.trajectory, motion.joints)):
        raise VerificationError(failures)
    from ccm_opt.driver.surviving import tolerance_of_motion  # noqa: PLC0415 - loads casadi

    errors = tolerance_of_motion(problem, motion.trajectory, motion.joints, simulated=simulated)
    record, picture = TOLERANCE_FILES
    _write(folder / record, tolerance_json(problem.name, errors).encode())
    if pictures:
        _write(folder / picture, _picture(problem, motion, errors[0]))
    return print_result(
        lambda: report_console().print(tolerance_table(problem, errors)),
        SOLVED,
        lambda: {"name": problem.name, "status": "certified", "tolerance": tolerance_data(errors)},
    )


def _picture(problem: AnyProblem, motion: SavedMotion, joints: SurvivedError) -> bytes:
    if isinstance(problem, SpaceProblem):
        from ccm_opt.viz.simulated_motion import space_tolerance_png  # noqa: PLC0415 - likewise

        return space_tolerance_png(problem, motion.trajectory, joints)
    from ccm_opt.verification.tolerance.error_model import joint_errors  # noqa: PLC0415 - with it
    from ccm_opt.verification.tolerance.tube import tube_of  # noqa: PLC0415 - with it
    from ccm_opt.viz.simulated_motion import tolerance_png  # noqa: PLC0415 - loads matplotlib

    tube = tube_of(problem.arm, motion.trajectory, joint_errors(problem.arm), joints.size)
    return tolerance_png(problem, motion.trajectory, joints, tube.region, tube.planned)


def _write(path: Path, content: bytes) -> None:
    try:
        put_file(path, content)
    except OSError as error:
        raise ProblemError(f"cannot write {path}: {error.strerror or error}") from error


def tolerance_table(problem: AnyProblem, errors: Sequence[SurvivedError]) -> Table:
    """The errors that a plan survives, with what limits them."""
    table = columned_table(f"{problem.name}: survives errors of, one at a time", ("", "up to", "asked", "limited by"))
    table.columns[-1].justify = "left"
    table.columns[-1].no_wrap = False
    units = units_of(problem)
    in_space = isinstance(problem, SpaceProblem)
    asked = problem.joint_error
    for error in errors:
        words = survived_in_words(error, units, in_space=in_space)
        limit = f"≥ {units.given(asked, 'rad')}" if error.name == "joints" and asked > 0.0 else ""
        table.add_row(words.wrong, words.size, limit, escape(words.where))
    return table
