"""What results say of themselves at a prompt and in a notebook, and how they are drawn, saved and loaded there."""

import json
from dataclasses import replace
from html import escape
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import ccm_opt
from ccm_opt.core.errors import ProblemError
from ccm_opt.driver.retargeting import _time_of
from ccm_opt.problem import JointPose

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
    """A loaded plan is one: verified, it looks and is saved as the first; films and reports go by their ending."""
    solution = solved("open-space")
    folder = solution.save(tmp_path / "kept")
    plan = ccm_opt.load(folder)
    assert repr(plan) == repr(solution).replace(f"{len(solution.checks)} checks", f"{len(plan.checks)} checks")
    again = plan.save(tmp_path / "again")
    for name in ("trajectory.csv", "trajectory.yaml"):
        assert (again / name).read_bytes() == (folder / name).read_bytes()
    before, after = (json.loads((each / "solution.json").read_text()) for each in (folder, again))
    different = {name for name in before if before[name] != after.get(name)}
    assert different <= {"goal_pose"}, different
    drawn = [figure.axes[0].get_title() for figure in (solution.plot(), plan.plot())]
    assert drawn[0] == drawn[1]
    film = solution.animate(tmp_path / "film.gif")
    assert film.read_bytes().startswith(b"GIF8")
    assert "open-space" in plan.report(tmp_path / "report.html").read_text()
    with pytest.raises(ProblemError, match=r"a film ends with \.gif or \.mp4, got 'film\.avi'"):
        ccm_opt.animate(plan, tmp_path / "film.avi")
    with pytest.raises(ProblemError, match=r"a report ends with \.html, got 'report\.pdf'"):
        ccm_opt.report(plan, tmp_path / "report.pdf")
    with pytest.raises(ProblemError, match="there is no such file"):
        ccm_opt.load(tmp_path / "nothing")


def test_a_loaded_plan_is_verified(tmp_path: Path) -> None:
    """A motion that touches an obstacle which was added to its folder is refused when it is loaded."""
    folder = solved("open-space").save(tmp_path / "kept")
    record = json.loads((folder / "solution.json").read_text())
    x, y = solved("open-space").joint_positions[-1, -1]
    record["problem"]["workspace"]["obstacles"] = [{"circle": {"center": [x, y], "radius": 0.05}}]
    (folder / "solution.json").write_text(json.dumps(record))
    with pytest.raises(ccm_opt.VerificationError, match="wall clearance"):
        ccm_opt.load(folder)


@given(share=st.floats(0.0, 1.0), noise=st.floats(0.0, 0.015))
def test_measured_joints_say_when_a_plan_is_there(share: float, noise: float) -> None:
    """Joints near the plan give a time at which it is as near as they are; others are refused with the worst joint."""
    solution = solved("open-space")
    trajectory, arm = solution.trajectory, solution.problem.arm
    sample = round(share * (len(trajectory.time) - 1))
    off = noise * np.where(np.arange(arm.links) % 2, 1.0, -1.0)
    at = _time_of(solution, JointPose(trajectory.positions[sample] + off))
    assert (
        np.max(np.abs(trajectory.positions[trajectory.time == at] - trajectory.positions[sample]))
        <= 2.0 * noise + 1e-12
    )
    with pytest.raises(ProblemError, match=r"off the plan: .* plan from its joints as the start"):
        _time_of(solution, JointPose(trajectory.positions[sample] + 0.5 * np.eye(arm.links)[0]))


def test_measured_joints_that_a_plan_passes_twice_are_refused() -> None:
    """There and back is ambiguous; the message names both times."""
    solution = solved("open-space")
    first = solution.trajectory
    time = np.concatenate((first.time, first.duration + first.time[1:]))
    back = replace(first, time=time, positions=np.vstack((first.positions, first.positions[-2::-1])))
    middle = JointPose(first.positions[len(first.time) // 2])
    with pytest.raises(ProblemError, match=r"at .* and .* s; give the time"):
        _time_of(replace(solution, trajectory=back), middle)
