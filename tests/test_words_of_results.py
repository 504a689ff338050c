"""What results say of themselves at a prompt and in a notebook, and how they are drawn, saved and loaded there."""

from html import escape
from pathlib import Path

import numpy as np
import pytest

import ccm_opt
from ccm_opt.core.errors import ProblemError

from .conftest import PROBLEMS
from .solved_problems import solved


def test_results_describe_themselves_in_a_line() -> None:
    """Problem, solution and its parts: name, size, duration, gap; never more than a line."""
    problem = ccm_opt.load_problem(PROBLEMS / "swan-neck.toml")
    assert repr(problem) == "<Problem 'swan-neck': 12 links, 0.600 m long, 4 obstacles>"
    solution = solved("swan-neck")
    duration = f"{solution.trajectory.duration:.2f} s"
    assert repr(solution).startswith(f"<Solution of 'swan-neck': 12 links, {duration}, wall clearance at least ")
    parts = (solution.path, solution.trajectory, solution.joints, solution.simulation)
    assert all(repr(part).startswith(f"<{type(part).__name__}") and len(repr(part)) < 150 for part in parts)
    table = solution._repr_html_()
    assert all(escape(check.name) in table for check in solution.checks)
    assert table.count("<tr>") == len(solution.checks) + 1


def test_plans_are_saved_loaded_and_drawn(tmp_path: Path) -> None:
    """A loaded plan passes the verifier, and looks like the one that was saved; films are written by their ending."""
    solution = solved("open-space")
    folder = solution.save(tmp_path / "kept")
    plan = ccm_opt.load(folder)
    np.testing.assert_array_equal(plan.trajectory.positions, solution.trajectory.positions)
    assert all(check.passed for check in ccm_opt.check(plan.problem, plan.trajectory, plan.joints))
    assert repr(plan).startswith("<SavedPlan of 'open-space'")
    drawn = [figure.axes[0].get_title() for figure in (solution.plot(), ccm_opt.plot(plan))]
    assert drawn[0] == drawn[1]
    film = solution.animate(tmp_path / "film.gif")
    assert film.read_bytes().startswith(b"GIF8")
    with pytest.raises(ProblemError, match=r"a film ends with \.gif or \.mp4, got 'film\.avi'"):
        ccm_opt.animate(plan, tmp_path / "film.avi")
    with pytest.raises(ProblemError, match="there is no such file"):
        ccm_opt.load(tmp_path / "nothing")
