"""``ccm-opt check``: verify a written plan again, from its files alone."""

from collections.abc import Sequence
from pathlib import Path

from ccm_opt.cli.outcome import NO_PLAN, SOLVED, report, run_all
from ccm_opt.cli.tables import checks_table, report_console
from ccm_opt.files.export.reading_back import load_motion, load_problem_data
from ccm_opt.files.problem_file import problem_from_mapping
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
    problem = problem_from_mapping(load_problem_data(folder), f"{folder}/solution.json")
    motion = load_motion(folder, problem.arm)
    checks = verify(problem, motion.trajectory, motion.joints)
    passed = all(check.passed for check in checks)
    title = f"{problem.name}: {'every check holds' if passed else 'refused'}"
    return report(lambda: report_console().print(checks_table(title, checks)), SOLVED if passed else NO_PLAN)
