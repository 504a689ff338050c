"""Planning for errors of the joints, and what is said of a plan: through the package and through the command line."""

import json
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import ccm_opt
from ccm_opt.cli.commands import app
from ccm_opt.core.errors import MotionNotFound, ProblemError, ProblemFileError
from ccm_opt.io.folder import write_solution
from ccm_opt.io.problem_data import problem_data
from ccm_opt.io.reading import parse_problem
from ccm_opt.problem import Problem
from ccm_opt.problem.solution import Solution
from ccm_opt.verification.tolerance.error_model import joint_errors
from ccm_opt.verification.tolerance.tolerated_errors import tolerated_error

SWAN_NECK = Path("problems/swan-neck.toml")
CHECK = "survived joint error"


@cache
def swan_neck(degrees: float) -> Problem:
    """The swan's neck with an error of its joints to survive."""
    return replace(ccm_opt.load_problem(SWAN_NECK), joint_error=float(np.deg2rad(degrees)), source="")


@cache
def solved(degrees: float) -> Solution:
    """Its solution."""
    return ccm_opt.solve(swan_neck(degrees), explain=False)


def test_a_motion_is_planned_to_survive_what_is_asked() -> None:
    """A motion that has to survive half a degree does, by a check of its own and by the certificate."""
    solution = solved(0.5)
    check = next(check for check in solution.checks if check.name == CHECK)
    assert check.passed
    assert check.limit == pytest.approx(np.deg2rad(0.5))
    problem = solution.problem
    certified = tolerated_error(problem, solution.trajectory, joint_errors(problem.arm))
    assert certified.size == pytest.approx(check.worst)
    assert certified.size >= np.deg2rad(0.5)


def test_the_verifier_refuses_a_plan_that_does_not_survive() -> None:
    """A plan for half a degree fails the check, and no other, where ten degrees are asked for."""
    solution = solved(0.5)
    checks = ccm_opt.check(swan_neck(10.0), solution.trajectory, solution.joints)
    assert [check.name for check in checks if not check.passed] == [CHECK]


@pytest.mark.drawn(2, of="planning for errors")
def test_what_cannot_be_survived_is_explained() -> None:
    """Where no motion survives the error, the reason names what limits the best, and an error that can be had."""
    problem = swan_neck(10.0)
    # No motion will do, so whatever time there is is spent.
    problem = replace(problem, planner=replace(problem.planner, time_limit=4.0))
    with pytest.raises(MotionNotFound) as caught:
        ccm_opt.solve(problem, explain=True)
    diagnosis = caught.value.diagnosis
    assert diagnosis.stage == "tolerance"
    assert "10°" in diagnosis.reason
    assert diagnosis.evidence["survived_deg"] > 0.1
    assert "tolerance.joint_error_deg" in diagnosis.advice[0]


def test_the_key_is_read_recorded_and_refused() -> None:
    """The key is read in degrees, round-trips, and a defect of it is named with its key path."""
    text = SWAN_NECK.read_text(encoding="utf-8")
    read = parse_problem(text + "\n[tolerance]\njoint_error_deg = 0.25\n")
    assert read.joint_error == pytest.approx(np.deg2rad(0.25))
    assert problem_data(read)["tolerance"] == {"joint_error_deg": pytest.approx(0.25)}
    with pytest.raises(ProblemFileError, match=r"tolerance\.joint_error_deg"):
        parse_problem(text + "\n[tolerance]\njoint_error_deg = -1.0\n")
    with pytest.raises(ProblemError, match="joint_error"):
        replace(read, joint_error=-0.1)


def test_tolerance_of_says_all_errors() -> None:
    """The call on a solution gives all errors with their units; loads are found by simulations."""
    errors = {error.name: error for error in ccm_opt.tolerance_of(solved(0.5))}
    assert list(errors) == [
        "joints", "link lengths", "base heading", "base position", "walls", "payload", "friction",
    ]  # fmt: skip
    assert {error.unit for error in errors.values()} == {"rad", "m", "kg", "N m s/rad"}
    assert all(error.size > 0.0 and error.where for error in errors.values())
    assert errors["joints"].size == pytest.approx(solved(0.5).tolerance[0].size)


def test_the_command_looks_at_a_written_plan(tmp_path: Path) -> None:
    """The command prints a table and writes record and picture; the solution's own record has the joints' error."""
    folder = write_solution(solved(0.5), tmp_path)
    record = json.loads((folder / "solution.json").read_text(encoding="utf-8"))
    assert record["tolerance"][0]["name"] == "joints"
    assert record["problem"]["tolerance"]["joint_error_deg"] == pytest.approx(0.5)

    result = CliRunner().invoke(app, ["tolerance", "--no-simulation", str(folder)])
    assert result.exit_code == 0, result.output
    assert "base turned by" in result.output
    written = json.loads((folder / "tolerance.json").read_text(encoding="utf-8"))
    assert written["tolerance"][0]["name"] == "joints"
    assert written["tolerance"][0]["size_deg"] >= 0.5
    assert (folder / "tolerance.png").read_bytes().startswith(b"\x89PNG")


def test_the_command_refuses_a_folder_without_a_plan(tmp_path: Path) -> None:
    """Where there is nothing to look at the exit code is that of bad input."""
    assert CliRunner().invoke(app, ["tolerance", str(tmp_path / "nowhere")]).exit_code == 2
