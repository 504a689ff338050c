"""A verified plan is never lost: whatever the simulation, a picture or Ctrl-C does, it is written and judged."""

import json
import os
import re
import signal
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from typer.testing import CliRunner

import ccm_opt
from ccm_opt.cli import solving
from ccm_opt.cli.commands import app
from ccm_opt.core.errors import CancelledWithPlan, Diagnosis, SimulationError
from ccm_opt.driver import closed_loop, solution_assembly
from ccm_opt.driver.closed_loop import simulate_and_check
from ccm_opt.dynamics.simulation import closed_loop_run
from ccm_opt.io.reading import parse_problem
from ccm_opt.problem import Disturbances, Problem, SimulationOptions, TipGoal
from ccm_opt.problem.solution import Solution

SWING = """
schema = 1
name = "swing"
[workspace]
bounds = [-0.8, -0.8, 0.8, 0.8]
[[workspace.obstacles]]
name = "post"
circle = { center = [0.58, -0.075], radius = 0.05 }
[arm]
links = 12
link_length = 0.05
radius = 0.015
base = [0.0, 0.0]
joint_limit_deg = 60.0
link_mass = 0.1
[limits]
velocity = 4.0
acceleration = 60.0
torque = 4.4
[start]
shape = "straight"
[goal]
joints_deg = [25, 3, 3, 3, 3, 3, 3, 3, 3, 3, 3, 3]
[planner]
effort_share = 1.0
"""
"""A swing up that takes all the torque there is: whatever disturbs it, a drive has nothing left."""
HEAVY = "[simulation.disturbances]\nmass_error = 0.1\n"


@pytest.fixture(scope="module")
def swing() -> Solution:
    """The plan, followed by an arm that is as its controller believes."""
    solution = ccm_opt.solve(parse_problem(SWING))
    assert solution.simulation.verdict.followed
    return solution


def disturbed(solution: Solution, **disturbances: float) -> Problem:
    """The problem with disturbances."""
    simulation = replace(solution.problem.simulation, disturbances=Disturbances(**disturbances))  # type: ignore[arg-type]
    return replace(solution.problem, simulation=simulation)


def run(*arguments: str) -> tuple[int, str, str]:
    """Exit code, standard output and standard error of a command."""
    result = CliRunner().invoke(app, list(arguments))
    return result.exit_code, result.stdout, result.stderr


def solve_text(text: str, tmp_path: Path, *options: str) -> tuple[int, str, str]:
    """``ccm-opt solve`` on the text of a problem, its folder in ``tmp_path / "runs"``."""
    file = tmp_path / "swing.toml"
    file.write_text(text, encoding="utf-8")
    return run("solve", str(file), "--out", str(tmp_path / "runs"), *options)


def is_kept(tmp_path: Path) -> dict[str, object]:
    """The record of the plan, which ``ccm-opt check`` accepts."""
    folder = tmp_path / "runs" / "swing"
    assert run("check", str(folder))[0] == 0
    record: dict[str, object] = json.loads((folder / "solution.json").read_text(encoding="utf-8"))
    assert record["status"] == "solved"
    return record


def test_a_plan_that_is_not_followed_is_written_and_told_apart(tmp_path: Path) -> None:
    """An arm that is heavier than believed, at its torque limits: a plan, a verdict everywhere, exit code 4."""
    code, out, err = solve_text(SWING + HEAVY, tmp_path)
    assert code == 4
    verdict = is_kept(tmp_path)["simulation"]
    assert isinstance(verdict, dict)
    assert verdict["outcome"] in {"saturated", "strayed", "touched", "diverged"}
    assert re.fullmatch(r"ball\d\d_bend", verdict["joint"])
    assert verdict["time"] > 0.0
    assert "torque limit" in verdict["reason"]
    assert re.search(rf"^Simulated arm +{verdict['outcome']}", out, re.MULTILINE)
    assert verdict["reason"].partition(";")[0] in err
    folder = tmp_path / "runs" / "swing"
    assert f">simulation: {verdict['outcome']}<" in (folder / "report.html").read_text(encoding="utf-8")
    with np.load(folder / "solution.npz") as arrays:
        assert np.isfinite(arrays["simulated_angles"]).all()


def test_the_share_is_what_makes_the_same_arm_follow(swing: Solution) -> None:
    """With 0.85 of the limits the arm that is 10 % too heavy follows; with all of them it does not."""
    careful = replace(
        disturbed(swing, mass_error=0.1),
        planner=replace(swing.problem.planner, effort_share=0.85),
        source="",
    )
    assert ccm_opt.solve(careful).simulation.verdict.followed
    motion, figures = simulate_and_check(disturbed(swing, mass_error=0.1), swing.trajectory, swing.joints)
    assert not motion.verdict.followed
    assert figures["saturated_time_s"] > 0.0


@pytest.mark.parametrize("error", [RuntimeError("no"), FloatingPointError("overflow")])
def test_a_defect_of_the_simulation_keeps_the_plan(
    error: Exception, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """What is not expected is logged with its traceback, and the plan is written as one that was not simulated."""

    def fails(*_: object, **__: object) -> None:
        raise error

    monkeypatch.setattr(closed_loop, "simulate", fails)
    code, _, err = solve_text(SWING, tmp_path, "--no-pictures")
    assert code == 4
    assert "not simulated" in err
    verdict = is_kept(tmp_path)["simulation"]
    assert isinstance(verdict, dict)
    assert verdict["outcome"] == "not simulated"
    assert type(error).__name__ in verdict["reason"]
    assert caplog.records[-1].exc_info is not None


def test_a_defect_of_the_room_keeps_the_plan(swing: Solution, monkeypatch: pytest.MonkeyPatch) -> None:
    """The record of the room is missing, and everything else is there."""

    def fails(*_: object, **__: object) -> None:
        raise ZeroDivisionError

    monkeypatch.setattr(solution_assembly, "clearance_record", fails)
    solution = ccm_opt.solve(swing.problem)
    assert solution.room is None
    assert solution.simulation.verdict.followed


@pytest.mark.parametrize("stage", ["clearance_record", "simulated_motion"])
def test_ctrl_c_after_the_verification_keeps_the_plan(
    stage: str, tmp_path: Path, swing: Solution, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The plan is written, the exit code is that of Ctrl-C; from Python it is in the exception."""

    def cancels(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(solution_assembly, stage, cancels)
    assert solve_text(SWING, tmp_path, "--no-pictures")[0] == 130
    verdict = is_kept(tmp_path)["simulation"]
    assert isinstance(verdict, dict)
    assert verdict["outcome"] == "not simulated"
    with pytest.raises(CancelledWithPlan) as caught:
        ccm_opt.solve(swing.problem)
    assert all(check.passed for check in caught.value.solution.checks)


@pytest.mark.parametrize(("error", "code"), [(KeyboardInterrupt(), 130), (RuntimeError("no ink"), 1)])
def test_a_plan_whose_pictures_fail_is_written_without(
    error: BaseException, code: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Neither Ctrl-C nor a defect while drawing loses the plan; the exit code says what happened."""

    def fails(*_: object) -> None:
        raise error

    monkeypatch.setattr(solving, "plan_pictures", fails)
    assert solve_text(SWING, tmp_path)[0] == code
    is_kept(tmp_path)
    assert not (tmp_path / "runs" / "swing" / "plan.png").exists()


def refuse_steps_above(step: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the stability check refuse every larger step, as it does for arms that are stiffer than they look."""

    def check(_: object, __: object, ___: object, options: SimulationOptions, **____: object) -> None:
        if options.step > step:
            raise SimulationError(Diagnosis("too stiff", "simulation", ("a smaller simulation.step",)))

    monkeypatch.setattr(closed_loop_run, "check_stability", check)


def test_a_smaller_step_is_tried_first(swing: Solution, monkeypatch: pytest.MonkeyPatch) -> None:
    """Half the step, and half of that, are tried until the arm follows twice; the verdict says what was used."""
    refuse_steps_above(0.3e-3, monkeypatch)
    motion, _ = simulate_and_check(swing.problem, swing.trajectory, swing.joints)
    assert motion.verdict.followed
    assert motion.verdict.step == 0.125e-3
    assert "but not with simulation.step = 0.001 s" in motion.verdict.reason


def test_where_a_step_too_long_leads_is_not_told_of_an_arm_that_follows(
    swing: Solution, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The verdict says which step was too long, and not how far off numbers were that mean nothing."""
    once = closed_loop.simulated_once

    def diverges(problem: Problem, *given: Any) -> closed_loop.JudgedMotion:
        judged = once(problem, *given)
        if problem.simulation.step < 0.6e-3:
            return judged
        verdict = replace(judged.motion.verdict, outcome="diverged", reason="the simulated ball is 1e7 rad off")
        return replace(judged, motion=replace(judged.motion, verdict=verdict))

    monkeypatch.setattr(closed_loop, "simulated_once", diverges)
    motion, _ = simulate_and_check(swing.problem, swing.trajectory, swing.joints)
    assert motion.verdict.followed
    assert motion.verdict.reason == "with steps of 0.00025 s, but not with simulation.step = 0.001 s"


def test_what_no_step_mends_is_a_verdict(swing: Solution, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where every step is refused the arm was not simulated, and the verdict has the reason and the advice."""
    refuse_steps_above(0.0, monkeypatch)
    motion, figures = simulate_and_check(swing.problem, swing.trajectory, swing.joints)
    assert motion.verdict.outcome == "not simulated"
    assert motion.verdict.reason == "too stiff"
    assert motion.verdict.advice == ("a smaller simulation.step",)
    assert motion.angles.shape == swing.joints.angles.shape
    assert not any("clearance" in name for name in figures)
    solution = ccm_opt.solve(swing.problem)
    assert not solution.simulation.verdict.followed


def overlap(problem: Problem, points: np.ndarray) -> float:
    """How deep the links overlap with the only obstacle, a circle, by shapely's distances [m]."""
    post = problem.workspace.obstacles[0]
    return max(
        post.rounding + problem.arm.radius - shapely.distance(shapely.LineString(points[k : k + 2]), post.core)
        for k in range(1, len(points) - 1)
    )


def test_the_first_touch_is_named_with_link_wall_and_time(swing: Solution) -> None:
    """Before the time that is named no pose overlaps with the post; at the next sample one does."""
    strong = replace(swing.problem.limits, torque=10.0 * np.asarray(swing.problem.limits.torque))
    problem = replace(disturbed(swing, payload=0.4), limits=strong)
    motion, _ = simulate_and_check(problem, swing.trajectory, swing.joints)
    verdict = motion.verdict
    assert verdict.outcome == "touched"
    assert verdict.obstacle == "'post'"
    assert verdict.time is not None
    assert verdict.link is not None
    assert f"link {verdict.link} touches 'post' at {verdict.time:.4g} s" in verdict.reason
    time = swing.trajectory.time
    poses = problem.arm.joint_positions_at(-motion.angles[:, 1::3])
    deep = np.array([overlap(problem, pose) for pose in poses]) > 2e-6
    first = int(np.argmax(deep))
    assert deep[first]
    assert not np.any(deep[time < verdict.time - 1e-9])
    assert verdict.time <= time[first] + 1e-9


def test_a_retargeted_plan_is_kept_too(swing: Solution) -> None:
    """A motion with a new goal that the simulated arm cannot follow comes back with its verdict."""
    heavy = replace(swing, problem=replace(disturbed(swing, mass_error=0.1), source=""))
    changed = ccm_opt.retarget(heavy, 0.5 * swing.trajectory.duration, TipGoal(np.array([0.5, 0.25])))
    assert all(check.passed for check in changed.checks)
    assert not changed.simulation.verdict.followed


def test_disturbances_never_raise(swing: Solution) -> None:
    """However an arm is disturbed, there is a verdict and all arrays are finite."""
    for disturbances in (
        {"payload": 100.0},
        {"friction": 1e3},
        {"mass_error": -0.99},
        {"mass_error": 50.0},
        {"start_delay": 100.0},
        {"angle_noise": 1.0, "velocity_noise": 10.0},
    ):
        motion, figures = simulate_and_check(disturbed(swing, **disturbances), swing.trajectory, swing.joints)
        assert not motion.verdict.followed, disturbances
        assert motion.verdict.reason
        assert np.isfinite(motion.angles).all()
        assert np.isfinite(motion.torques).all()
        assert not np.isnan([figure for name, figure in figures.items() if name != "tracking_error_rad"]).any()


@pytest.mark.drawn(1)
@pytest.mark.parametrize("error", [KeyboardInterrupt(), RuntimeError("no ink")])
def test_an_earlier_plan_stays_where_the_next_is_cut_short(
    error: BaseException, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The new plan, without pictures, is written beside the earlier one, of which no byte changes."""
    assert solve_text(SWING, tmp_path)[0] == 0
    folder = tmp_path / "runs" / "swing"
    before = {path.name: path.read_bytes() for path in folder.iterdir()}

    def fails(*_: object) -> None:
        raise error

    monkeypatch.setattr(solving, "plan_pictures", fails)
    said = solve_text(SWING, tmp_path)[2]
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == before
    assert (folder.with_name("swing.unfinished") / "solution.npz").is_file()
    assert "keeps its earlier result" in said


@pytest.mark.drawn(1)
@pytest.mark.parametrize("step", ["write_folder", "print_solution"])
def test_ctrl_c_when_the_folder_is_all_but_done_is_too_late(
    step: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The problem is solved, with pictures, and its exit code says so; the file after it is not tried."""
    usual = getattr(solving, step)
    handler = signal.getsignal(signal.SIGINT)

    def interrupted(*arguments: object) -> object:
        os.kill(os.getpid(), signal.SIGINT)
        return usual(*arguments)

    monkeypatch.setattr(solving, step, interrupted)
    assert solve_text(SWING, tmp_path)[0] == 0
    assert (tmp_path / "runs" / "swing" / "report.html").is_file()
    other = tmp_path / "other.toml"
    other.write_text(SWING.replace('"swing"', '"other"'))
    files = [str(tmp_path / "swing.toml"), str(other)]
    code, _, said = run("solve", *files, "--out", str(tmp_path / "runs"), "--no-pictures")
    assert (code, "cancelled" in said) == (130, True)
    assert not (tmp_path / "runs" / "other").exists()
    assert signal.getsignal(signal.SIGINT) is handler
