"""``ccm-opt check``: verify a written plan again, from its files alone."""

from collections.abc import Sequence
from pathlib import Path

from ccm_opt.cli.outcome import NO_PLAN, SOLVED, print_result, run_all
from ccm_opt.cli.tables import checks_table, print_room, report_console
from ccm_opt.files.export.reading_back import load_motion, load_recorded_problem
from ccm_opt.verification import verify
from ccm_opt.verification.room_over_time import room_over_time


def check_folders(folders: Sequence[Path]) -> int:
    """Verify every folder; all are tried.

    Args:
        folders: output folders of ``ccm-opt solve``.

    Returns:
        The exit code.
    """
    return run_all(folders, _check)


def _check(folder: Path) -> int:
    problem = load_recorded_problem(folder)
    motion = load_motion(folder, problem.arm)
    checks = verify(problem, motion.trajectory, motion.joints)
    passed = all(check.passed for check in checks)
    title = f"{problem.name}: {'every check holds' if passed else 'refused'}"
    # The room of a motion that is refused is in the checks that refuse it.
    room = room_over_time(problem, motion.trajectory, problem.wanted_gap, checks) if passed else None

    def show() -> None:
        console = report_console()
        console.print(checks_table(title, checks))
        print_room(console, room)

    return print_result(show, SOLVED if passed else NO_PLAN)
