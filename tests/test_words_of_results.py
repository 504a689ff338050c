"""What results say of themselves at a prompt and in a notebook: a line, and a table, not their arrays."""

from html import escape

import ccm_opt

from .conftest import PROBLEMS


def test_results_describe_themselves_in_a_line() -> None:
    """Problem, solution and its parts: name, size, duration, gap; never more than a line."""
    problem = ccm_opt.load_problem(PROBLEMS / "swan-neck.toml")
    assert repr(problem) == "<Problem 'swan-neck': 12 links, 0.600 m long, 4 obstacles>"
    solution = ccm_opt.solve(problem)
    duration = f"{solution.trajectory.duration:.2f} s"
    assert repr(solution).startswith(f"<Solution of 'swan-neck': 12 links, {duration}, walls no nearer than ")
    parts = (solution.path, solution.trajectory, solution.joints, solution.simulation)
    assert all(repr(part).startswith(f"<{type(part).__name__}") and len(repr(part)) < 150 for part in parts)
    table = solution._repr_html_()
    assert all(escape(check.name) in table for check in solution.checks)
    assert table.count("<tr>") == len(solution.checks) + 1
