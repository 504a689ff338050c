"""Motions in space that are planned to survive an error of the joints, several tries, and timing by another's hand."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import ccm_opt
from ccm_opt.cli.commands import app
from ccm_opt.core.errors import MotionNotFound
from ccm_opt.problem import Problem
from ccm_opt.problem.solution import JointPath, JointTrajectory
from ccm_opt.verification.tolerance.error_model import joint_errors
from ccm_opt.verification.tolerance.tolerated_errors import tolerated_error
from tests.test_user_terms_in_space import POST, free_motion, post


def asking(degrees: float) -> Problem:
    """The arm beside the ball, with an error of every joint."""
    return replace(post(), joint_error=float(np.deg2rad(degrees)), source="")


@pytest.mark.drawn(2, of="planning for errors")
def test_more_is_survived_where_more_is_asked_for() -> None:
    """The free motion survives less than is asked for, and the planned one all of it, by a check of its own."""
    free = free_motion()
    without = tolerated_error(post(), free.trajectory, joint_errors(post().arm))
    wanted = 2.5 * np.rad2deg(without.size)
    solution = ccm_opt.solve(asking(wanted))
    check = next(check for check in solution.checks if check.name == "survived joint error")
    assert check.passed
    assert check.worst >= np.deg2rad(wanted)
    again = tolerated_error(asking(wanted), solution.trajectory, joint_errors(post().arm))
    assert again.size == pytest.approx(check.worst)


@pytest.mark.drawn(2, of="planning for errors")
def test_what_no_motion_survives_is_told_with_what_the_best_one_does() -> None:
    """The reason names the error that is survived, what limits it, and a smaller error that can be had."""
    with pytest.raises(MotionNotFound, match=r"tolerates joint errors of 20°: the best tolerates .*'ball'") as caught:
        ccm_opt.solve(asking(20.0))
    assert caught.value.diagnosis.stage == "tolerance"
    assert "tolerance.joint_error_deg" in caught.value.diagnosis.advice[0]


def test_the_folder_of_such_a_plan_is_checked_for_it_too(tmp_path: Path) -> None:
    """``solve`` writes the check, and ``check`` makes it anew."""
    (tmp_path / "post.toml").write_text(POST + "\n[tolerance]\njoint_error_deg = 0.02\n")
    solved = CliRunner().invoke(app, ["solve", str(tmp_path / "post.toml"), "--no-pictures", "--out", str(tmp_path)])
    assert solved.exit_code == 0, solved.output
    again = CliRunner().invoke(app, ["check", str(tmp_path / "post"), "--json"])
    assert again.exit_code == 0, again.output
    assert "survived joint error" in again.output


def test_of_several_tries_the_best_is_taken_and_all_are_told() -> None:
    """Each has the next seed; one of them is taken."""
    problem = post()
    solution = ccm_opt.solve(replace(problem, planner=replace(problem.planner, tries=2, seed=5)))
    assert [each.seed for each in solution.tries] == [5, 6]
    assert sum(each.taken for each in solution.tries) == 1


def test_a_retimer_of_the_users_times_the_path() -> None:
    """What it returns is verified like the package's own."""

    class Slow:
        """Half as fast as the limits allow."""

        def retime(self, problem: Problem, path: JointPath) -> JointTrajectory:
            """Time the path within half of the limits of speed and a quarter of those of acceleration."""
            limits = problem.limits
            slow = replace(limits, velocity=0.5 * limits.velocity, acceleration=0.25 * limits.acceleration)
            return ccm_opt.BuiltInRetimer().retime(replace(problem, limits=slow), path)

    usual = free_motion()
    slow = ccm_opt.solve(post(), retimer=Slow())  # type: ignore[call-overload]
    assert slow.trajectory.duration > 1.5 * usual.trajectory.duration
    assert all(check.passed for check in slow.checks)
