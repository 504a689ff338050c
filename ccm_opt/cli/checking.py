"""``ccm-opt check``: verify a written plan again, from its files alone."""

from collections.abc import Sequence
from pathlib import Path

from ccm_opt.cli.outcome import NO_PLAN, SOLVED, print_result, run_all
from ccm_opt.cli.tables import checks_table, report_console
from ccm_opt.files.export.reading_back import load_motion, load_recorded_problem
from ccm_opt.verification import verify


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
    return print_result(lambda: report_console().print(checks_table(title, checks)), SOLVED if passed else NO_PLAN)
