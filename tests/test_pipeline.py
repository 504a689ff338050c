"""The driver: what it returns is verified, what it cannot verify it refuses, and what it cannot plan it explains."""

from dataclasses import dataclass, field, replace

import numpy as np
import pytest
import shapely
from scipy.interpolate import make_interp_spline

import ccm_opt
from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import Diagnosis, MotionNotFound, UnreachableGoal, VerificationError
from ccm_opt.core.progress import Stages
from ccm_opt.driver.pipeline import solve
from ccm_opt.driver.solution_assembly import PACKAGES
from ccm_opt.dynamics.retiming.timing_settings import SamplingSettings, TimingSettings
from ccm_opt.io.reading import parse_problem
from ccm_opt.problem import JointPose, Problem, TipGoal
from ccm_opt.problem.solution import JointPath, Solution
from ccm_opt.robot.configuration import Configuration
from ccm_opt.scene.workspace import Obstacle, PlaneShape, Workspace
from ccm_opt.verification.verification_settings import VerificationSettings

from .conftest import PROBLEMS, SMALL_PROBLEM
from .scenes import Scene, clutter, make_arm, open_scene, self_gap, wall_gaps
from .solved_problems import solved

NAMES = sorted(path.stem for path in PROBLEMS.glob("*.toml"))
SEQUENCE = """
[[goal]]
position = [0.3, 0.1]
pause = 0.2

[[goal]]
position = [0.32, -0.12]
"""
STAGES = ["dynamics model", "retiming", "verification", "clearance", "tolerance", "simulation"]
"""Of the driver itself; the planner's come before."""


def load(name: str) -> Problem:
    """One of the nine problems."""
    return ccm_opt.load_problem(PROBLEMS / f"{name}.toml")


@dataclass(frozen=True)
class Straight:
    """A planner that goes straight through joint space, whatever stands there."""

    start: FloatArray
    end: FloatArray
    asked: list[str] = field(default_factory=list)

    def plan(self, problem: Problem) -> JointPath:
        """A path of five keyframes on a line."""
        self.asked.append(problem.name)
        u = np.linspace(0.0, 1.0, 5)
        keyframes = self.start + u[:, None] * (self.end - self.start)
        arm = problem.arm
        curve = Configuration.chain(arm.base, arm.base_heading, [arm.length], [np.zeros(5)])
        return JointPath(make_interp_spline(u, keyframes, k=3), keyframes, (curve,) * 5, "straight")


@dataclass(frozen=True)
class Hopeless:
    """A planner that finds nothing."""

    def plan(self, problem: Problem) -> JointPath:
        """No plan."""
        raise MotionNotFound(Diagnosis(f"nothing for {problem.name}", "motion"))


def assert_sound(solution: Solution) -> None:
    """Every check passes, the checks are those of the verifier, and nothing touches anything at the samples."""
    problem = solution.problem
    assert all(check.passed for check in solution.checks)
    again = ccm_opt.check(problem, solution.trajectory, solution.joints)
    assert [check.name for check in again] == [check.name for check in solution.checks]
    assert all(check.passed for check in again)
    points = solution.joint_positions[::5]
    assert points.shape[1:] == (problem.arm.links + 1, 2)
    assert wall_gaps(problem.arm, problem.workspace, points).min() > -1e-6
    if problem.arm.self_collision:
        assert self_gap(problem.arm, points) > -1e-6
    assert_at_rest(solution)


def assert_at_rest(solution: Solution) -> None:
    """The motion starts and ends at rest, and stays within the limits at every sample."""
    trajectory, limits = solution.trajectory, solution.problem.limits
    assert np.abs(trajectory.bend_velocities[[0, -1]]).max() < 1e-6 * limits.velocity.max()
    assert (np.abs(trajectory.bend_velocities) <= limits.velocity[1::3]).all()
    assert (np.abs(trajectory.bend_accelerations) <= limits.acceleration[1::3] * (1.0 + 1e-9)).all()
    assert (np.abs(trajectory.bend_angles) <= solution.problem.arm.bend_limits).all()


def tip_error(solution: Solution, goal: TipGoal) -> tuple[float, float]:
    """Distance of the last tip from the goal [m] and turn of the last link from its heading [rad]."""
    arm = solution.problem.arm
    heading = arm.base_heading + solution.trajectory.bend_angles[-1].sum()
    turn = 0.0 if goal.heading is None else 2.0 * np.arcsin(abs(np.sin(0.5 * (heading - goal.heading))))
    return float(np.hypot(*(solution.joint_positions[-1, -1] - goal.position))), float(turn)


def test_a_solution_is_verified_and_complete() -> None:
    """A problem is solved: checks pass, the tip is on the goal, the motion starts at the start, figures are told."""
    problem, heard = load("swan-neck"), []
    solution = solve(problem, progress=heard.append)
    assert_sound(solution)
    assert isinstance(problem.goal, TipGoal)
    distance, turn = tip_error(solution, problem.goal)
    assert distance <= problem.tolerances.position
    assert turn <= problem.tolerances.heading
    np.testing.assert_allclose(solution.trajectory.bend_angles[0], problem.start.bends, atol=1e-9)
    told = [progress.stage for progress in heard if not progress.candidate]
    assert told[-len(STAGES) :] == STAGES
    assert all(progress.elapsed >= 0.0 for progress in heard)
    assert {progress.limit for progress in heard} == {problem.planner.time_limit}
    tried = [progress for progress in heard if progress.candidate]
    assert tried[0].candidate == 1
    assert tried[0].name
    assert list(solution.timings) == list(dict.fromkeys(told))
    assert {"free space", "motion"} <= set(told)
    assert solution.metrics["duration_s"] == solution.trajectory.duration > 0.0
    assert solution.metrics["tip_error_m"] == pytest.approx(distance, abs=1e-12)
    assert solution.metrics["heading_error_rad"] == pytest.approx(turn, abs=1e-9)
    assert set(solution.versions) == {"python", *PACKAGES}
    assert len(solution.path.curves) == len(solution.path.keyframes) == solution.metrics["keyframes"]


def test_settings_reach_the_stages() -> None:
    """Finer samples are taken when they are asked for, and a verifier that asks for finer ones still refuses them."""
    problem = parse_problem(SMALL_PROBLEM)
    fine = TimingSettings(sampling=SamplingSettings(step=1e-3))
    solution = solve(problem, settings=ccm_opt.Settings(timing=fine))
    assert np.max(np.diff(solution.trajectory.time)) <= 1e-3
    assert np.max(np.diff(solve(problem).trajectory.time)) > 1e-3
    strict = ccm_opt.Settings(timing=fine, verification=VerificationSettings(largest_step=0.5e-3))
    with pytest.raises(VerificationError, match="samples"):
        solve(problem, settings=strict)


def test_the_path_passes_through_its_ends() -> None:
    """The spline of a solution starts at the first keyframe, ends at the last, and is what the trajectory follows."""
    solution = solved("open-space")
    path, trajectory = solution.path, solution.trajectory
    np.testing.assert_allclose(path.spline([0.0, 1.0]), path.keyframes[[0, -1]], atol=1e-12)
    np.testing.assert_allclose(trajectory.bend_angles[[0, -1]], path.keyframes[[0, -1]], atol=1e-9)
    dense = path.spline(np.linspace(0.0, 1.0, 4001))
    for bends in trajectory.bend_angles[:: len(trajectory.time) // 20]:
        assert np.abs(dense - bends).max(axis=1).min() < 1e-3


@pytest.mark.parametrize("name", ["wall clearance", "self-collision", "goal position", "start joints"])
def test_what_the_verifier_refuses_is_no_solution(name: str) -> None:
    """A planner whose path hits a post, folds into itself, ends elsewhere or starts elsewhere: refused, and why."""
    scene = open_scene(3)
    post = Obstacle("post", PlaneShape(shapely.Point(0.6 * np.cos(0.4), 0.6 * np.sin(0.4)), 0.03))
    room = Workspace(scene.workspace.boundary, (post,) if name == "wall clearance" else ())
    start, end = np.zeros(24), np.append(0.8, np.zeros(23))
    if name == "self-collision":
        end = np.full(24, 0.4)
    goal = TipGoal(scene.arm.joint_positions(scene.arm.headings(end))[-1])
    problem = Scene(scene.arm, room, np.zeros(24), np.zeros(24)).problem(goal)
    planner = Straight(
        start + (0.1 if name == "start joints" else 0.0), end + (0.1 if name == "goal position" else 0.0)
    )
    with pytest.raises(VerificationError) as caught:
        solve(problem, planner=planner)
    assert any(failure.startswith(name) for failure in caught.value.failures)
    assert name not in ("wall clearance", "self-collision") or len(caught.value.failures) == 1
    assert planner.asked == ["scene"]


def test_another_planner_may_solve_it() -> None:
    """Any planner will do whose path the verifier passes."""
    scene = open_scene(3)
    end = np.append(0.8, np.full(23, 0.02))
    goal = TipGoal(scene.arm.joint_positions(scene.arm.headings(end))[-1])
    problem = Scene(scene.arm, scene.workspace, np.zeros(24), np.zeros(24)).problem(goal)
    solution = solve(problem, planner=Straight(np.zeros(24), end))
    assert_sound(solution)
    assert solution.path.candidate == "straight"
    assert list(solution.timings) == ["dynamics model", "necessary checks", *STAGES[1:]]


def test_the_planners_reason_reaches_the_caller() -> None:
    """NoPlanFound of a planner passes through with its diagnosis."""
    with pytest.raises(MotionNotFound, match="nothing for scene"):
        solve(open_scene(1).problem(), planner=Hopeless())


def test_a_goal_for_every_joint_is_reached() -> None:
    """A goal of joint bends is met by every joint."""
    scene = clutter(6, 15)
    goal = JointPose(scene.arm.bends(scene.goal))
    solution = solve(scene.problem(goal))
    assert_sound(solution)
    np.testing.assert_allclose(solution.trajectory.bend_angles[-1], goal.bends, atol=1e-6)
    assert "tip_error_m" not in solution.metrics


def test_a_goal_for_the_whole_curve_is_reached() -> None:
    """A goal given as a curve is met by the arm laid on it."""
    scene = clutter(8, 15)
    curve = Configuration.chain(
        np.zeros(2), 0.3, [0.5, 0.5], [np.array([0.0, 1.0, 2.0, 2.0, 1.0]), np.linspace(1, -2, 5)]
    )
    room = Workspace(scene.workspace.boundary)
    problem = replace(Scene(scene.arm, room, scene.start, scene.goal).problem(), goal=JointPose.along(scene.arm, curve))
    solution = solve(problem)
    assert_sound(solution)
    wanted = JointPose.along(scene.arm, curve).bends
    np.testing.assert_allclose(solution.trajectory.bend_angles[-1], wanted, atol=1e-6)


def test_a_goal_without_heading_is_reached() -> None:
    """A place for the tip is enough of a goal."""
    scene = clutter(4, 15)
    goal = TipGoal(scene.goal_tip.position)
    solution = solve(scene.problem(goal))
    assert_sound(solution)
    assert tip_error(solution, goal)[0] <= 1e-3
    assert "heading_error_rad" not in solution.metrics


def test_a_goal_at_the_start_is_a_short_motion() -> None:
    """A tip that is on its goal already needs no motion to speak of."""
    scene = clutter(2, 15)
    tip = TipGoal(scene.arm.joint_positions(scene.start)[-1], heading=float(scene.start[-1]))
    solution = solve(scene.problem(tip))
    assert_sound(solution)
    assert solution.metrics["joint_path_length_rad"] < 1.0


def test_an_arm_of_few_links_that_is_at_its_goal_already_has_a_plan() -> None:
    """Trees that join their roots leave nothing between the ends."""
    arm = {"links": 4, "link_length": 0.125, "radius": 0.01, "base": (0, 0), "joint_limit_deg": 90}
    limits = {"velocity": 1.0, "acceleration": 4.0}
    problem = ccm_opt.make_problem("there", arm=arm, room=(-1, -1, 1, 1), limits=limits, goal=(0.5, 0.0))
    assert solve(problem).trajectory.duration < 1.0


@pytest.mark.parametrize("which", ["start", "goal"])
def test_an_end_that_touches_is_refused_by_name(which: str) -> None:
    """An arm that stands in an obstacle at its start, or is asked to, is told which link touches what."""
    scene = open_scene(5)
    touched = scene.start if which == "start" else scene.goal
    post = Obstacle("the post", PlaneShape(shapely.Point(scene.arm.joint_positions(touched)[12]), 0.01))
    workspace = Workspace(scene.workspace.boundary, (post,))
    problem = Scene(scene.arm, workspace, scene.start, scene.goal).problem(JointPose(scene.arm.bends(scene.goal)))
    with pytest.raises(UnreachableGoal, match=rf"the {which} .*link 1[23].*'the post'"):
        solve(problem)


def test_a_start_beyond_a_joint_limit_is_refused() -> None:
    """The message names joint, angle and limit."""
    arm = make_arm(joint_limit=np.deg2rad(20.0))
    bends = np.where(np.arange(24) == 6, np.deg2rad(25.0), 0.0)
    problem = replace(Scene(arm, open_scene(0).workspace, np.zeros(24), np.zeros(24)).problem(), start=JointPose(bends))
    with pytest.raises(UnreachableGoal, match=r"bends joint 7 by 25\.00°, but its limit is 20\.00°"):
        solve(replace(problem, goal=TipGoal(np.array([0.5, 0.5]))))


def test_a_goal_out_of_reach_is_refused() -> None:
    """A goal farther away than the arm is long is refused with both lengths."""
    with pytest.raises(UnreachableGoal, match=r"(?s)1\.\d+ m.* 1\.000 m"):
        solve(open_scene(0).problem(TipGoal(np.array([1.1, 0.5]))))


def test_stages_are_told_and_timed() -> None:
    """Each stage is announced when it starts; times of the same name add up, also when the block fails."""
    told: list[str] = []
    stages = Stages(lambda progress: told.append(progress.stage))
    with stages("one"):
        sum(range(200_000))
    first = stages.timings["one"]

    def failing() -> None:
        with stages("one"):
            sum(range(200_000))
            raise KeyError("x")

    with pytest.raises(KeyError):
        failing()
    with stages("two"):
        pass
    assert told == ["one", "one", "two"]
    assert list(stages.timings) == ["one", "two"]
    assert stages.timings["one"] > first > 0.0


@pytest.mark.drawn(4)
@pytest.mark.planning
@pytest.mark.parametrize("name", NAMES)
def test_every_problem_is_solved_at_its_own_link_count(name: str) -> None:
    """Every problem of the folder is solved as it stands: every check of the independent verifier passes."""
    solution = solved(name)
    problem = solution.problem
    assert solution.trajectory.bend_angles.shape[1] == problem.arm.links
    assert_sound(solution)
    if not isinstance(problem.goal, TipGoal):
        return
    distance, turn = tip_error(solution, problem.goal)
    assert distance <= problem.tolerances.position
    assert turn <= problem.tolerances.heading


def test_goals_in_sequence_are_one_verified_motion_with_rests() -> None:
    """The arm rests at each view for its pause, and the whole motion passes the verifier."""
    problem = parse_problem(SMALL_PROBLEM.split("[goal]", maxsplit=1)[0] + SEQUENCE)
    solution = solve(problem)
    (stop,) = solution.trajectory.stops
    tip = solution.joint_positions[stop, -1]
    np.testing.assert_allclose(tip, [0.3, 0.1], atol=1e-3)
    resting = np.max(np.abs(solution.trajectory.bend_velocities), axis=1) == 0.0
    time = solution.trajectory.time
    assert time[resting & (time > time[stop])].min() == pytest.approx(time[stop], abs=5e-3)
    assert np.ptp(time[resting & (time >= time[stop]) & (time < time[-1])]) == pytest.approx(0.2, abs=1e-9)
    assert {"stop 1 position", "goal position"} <= {check.name for check in solution.checks}
    assert all(check.passed for check in solution.checks)
