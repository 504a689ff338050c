"""The end of a motion: rows that ask for room of the smooth path, bending to another end, weights of busy joints."""

from dataclasses import replace
from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ccm_opt import solve
from ccm_opt.planning.curve_map import CurveMap
from ccm_opt.planning.ending import bent_to, weighing_bottlenecks
from ccm_opt.planning.ends import resolve_ends
from ccm_opt.planning.goal import GoalPose
from ccm_opt.planning.goal_pose import poses_at_goal
from ccm_opt.planning.link_space import LinkSpace
from ccm_opt.planning.motion import Motion, SpaceMotion
from ccm_opt.planning.motion_task import MotionTask
from ccm_opt.planning.optimisation.optimise import optimise, with_more_clearance
from ccm_opt.planning.spline_path import clamped_spline, smoothing_matrix
from ccm_opt.planning.strategies import find_motion
from ccm_opt.planning.swept_motion import PlanarSweep
from ccm_opt.problem import Problem
from tests.scenes import clutter, make_arm, mixed_walls, motion_task, rows_of, sweep_gaps, swept
from tests.snakes_in_space import balls, snake, task_of

MARGIN = 1e-3
WANTED = 8e-3


@cache
def optimised(seed: int) -> tuple[Problem, MotionTask, Motion]:
    """A scene's problem, its task, and a motion that was optimised with a free end."""
    problem = clutter(seed, 20).problem()
    task = motion_task(problem, guessing=True)
    motion = find_motion(replace(task, optimiser="none"))
    return problem, task, optimise(motion, replace(task, wanted_gap=problem.wanted_gap))


# ---------------------------------------------------------------- the smooth path and its room
@pytest.mark.parametrize("keyframes", [4, 5, 9, 21, 40])
def test_the_smoothing_matrix_gives_values_of_the_spline(keyframes: int) -> None:
    """Beside each control point it gives the spline, straight motions stay, and both ends too."""
    matrix = smoothing_matrix(keyframes)
    control = np.random.default_rng(keyframes).normal(size=(keyframes, 3))
    spline = clamped_spline(control)
    places = [np.mean(spline.t[k + 1 : k + 4]) for k in range(keyframes)]
    assert matrix @ control == pytest.approx(spline(places))
    assert (matrix @ control)[[0, -1]] == pytest.approx(control[[0, -1]])
    # The control points of a straight line at even speed lie at the same places (linear precision).
    assert matrix @ np.array(places) == pytest.approx(places)


@settings(deadline=None, max_examples=30)
@given(st.integers(0, 2**32 - 1), st.integers(4, 8))
def test_rows_ask_for_the_room_of_the_smooth_path(seed: int, intervals: int) -> None:
    """A row for room asks no less than that for contact, and no less than the wanted gap beside the smooth path."""
    rng = np.random.default_rng(seed)
    space, start = LinkSpace.through(make_arm(), rng.normal(0.0, 0.5, 24) / 4.0)
    steps = 0.2 * rng.normal(size=(intervals, len(start)))
    sweep = PlanarSweep(space, np.vstack((start, start + np.cumsum(steps, axis=0))))
    smooth = PlanarSweep(space, smoothing_matrix(intervals + 1) @ sweep.unknowns)
    workspace = mixed_walls()
    contact = rows_of(sweep, workspace, MARGIN, 0.3)
    room = rows_of(sweep, workspace, MARGIN, 0.3, wanted=WANTED)
    assert np.array_equal(room.normal, contact.normal)
    asked = room.values(sweep)
    known = contact.values(sweep)
    assert np.all(asked >= known - 1e-12)

    keyframe = room.interval + room.share.astype(np.intp)
    assert asked[keyframe == 0] == pytest.approx(known[keyframe == 0])
    walls = (room.minus == 0) & (keyframe > 0) & (room.low == 0)
    apart = smooth.points - sweep.points
    nearer = np.einsum("md,md->m", room.normal, apart[keyframe, room.plus] - apart[keyframe, room.minus])
    sag = sweep.chord_deviation[room.interval, room.high] - sweep.chord_deviation[room.interval, room.low]
    beside = known - sag + (WANTED - MARGIN) + nearer
    links = space.arm.link_margins(room.low, room.high - 1, WANTED) < WANTED
    assert np.all(asked[walls & ~links] >= beside[walls & ~links] - 1e-12)


# ---------------------------------------------------------------- more keyframes where room is lacking
def room(motion: Motion, task: MotionTask) -> float:
    """Least gap of the spline along a motion, densely sampled [m]."""
    return task.least_gap(clamped_spline(motion.configurations)(np.linspace(0.0, 1.0, 1000)))


@pytest.mark.drawn(1)
@pytest.mark.parametrize("seed", [90_111, 90_115])
def test_a_motion_that_lacks_room_gets_more_of_it(seed: int) -> None:
    """From a motion after one step, which grazes walls, to one that keeps what is wanted or what its ends leave."""
    problem = clutter(seed, 40).problem()
    task = replace(motion_task(problem, guessing=True), wanted_gap=problem.wanted_gap)
    found = find_motion(replace(task, optimiser="none"))
    grazing = optimise(found, task, rounds=1)
    to_end = task.with_goal_pose(grazing.unknowns[-1], grazing.configurations[-1])
    widened = with_more_clearance(grazing, to_end)
    assert widened.configurations[[0, -1]] == pytest.approx(grazing.configurations[[0, -1]], abs=1e-9)
    frames = [swept(a, b, 10) for a, b in pairwise(task.arm.headings(widened.configurations))]
    walls, own = sweep_gaps(problem.arm, problem.workspace, np.vstack(frames))
    assert walls > 0.0
    assert own > 0.0

    before = room(grazing, task)
    most = min(problem.wanted_gap, task.least_gap(grazing.configurations[[0, -1]]))
    assert before < 0.8 * most
    assert room(widened, task) > before
    assert room(widened, task) >= 0.9 * most


def test_a_motion_with_room_stays_as_it_is() -> None:
    """Nothing is lacking where nothing is wanted, or where all that is wanted is there."""
    _, task, motion = optimised(90_100)
    assert with_more_clearance(motion, task) is motion
    little = replace(task, wanted_gap=0.5 * room(motion, replace(task, wanted_gap=WANTED)))
    assert with_more_clearance(motion, little) is motion


def test_a_motion_whose_smooth_path_cuts_a_corner_gets_more_keyframes() -> None:
    """Round a ball the legs of four keyframes keep all that is wanted, but their spline touches; then that keeps it."""
    arm = snake(8)
    turns = np.zeros((4, 16))
    turns[:, :2] = [[-0.5, 0.0], [-0.5, -0.4], [0.5, -0.4], [0.5, 0.0]]
    touched = np.zeros(16)
    touched[1] = -0.3
    ball = balls(0.8 * arm.joint_positions_at(touched)[-1:], 0.04)
    goal = GoalPose(arm.joint_positions_at(turns[-1])[-1], None)
    task = replace(task_of(arm, ball, goal, goal_pose=turns[-1], start=turns[0]), wanted_gap=0.005)
    curve, _ = CurveMap.through(arm, turns[0])
    curve, _ = curve.blended_to(turns[-1])
    unknowns = np.stack([curve.fitted(q) for q in turns])
    round_it = SpaceMotion(curve, unknowns, turns, "round the ball")
    assert len(task.failures(curve, unknowns)) == 0

    def gap(motion: SpaceMotion) -> float:
        """Least gap of the spline along a motion, densely sampled [m]."""
        return task.least_gap(curve.configurations(clamped_spline(motion.unknowns)(np.linspace(0.0, 1.0, 1000))))

    assert gap(round_it) < 0.0
    assert gap(with_more_clearance(round_it, task)) >= 0.9 * task.wanted_gap


# ---------------------------------------------------------------- another end
@pytest.mark.parametrize("seed", [90_100, 90_101, 90_102])
def test_a_motion_is_bent_to_the_goal_pose(seed: int) -> None:
    """It begins where it began, ends in the other pose to rounding, and a dense sweep of it touches nothing."""
    problem, task, motion = optimised(seed)
    end = motion.configurations[-1]
    pose = poses_at_goal(problem, resolve_ends(problem), end).best(end)
    assert pose is not None
    bent = bent_to(motion, pose.q, task)
    assert bent is not None
    assert bent.configurations[0] == pytest.approx(motion.configurations[0], abs=1e-12)
    assert bent.configurations[-1] == pytest.approx(pose.q, abs=1e-9)
    assert bent.end_pose is not None
    frames = [swept(a, b, 30) for a, b in pairwise(task.arm.headings(bent.configurations))]
    walls, own = sweep_gaps(problem.arm, problem.workspace, np.vstack(frames))
    assert walls > 0.0
    assert own > 0.0


def test_an_end_behind_a_wall_is_not_reached() -> None:
    """Where no certified way leads to another end, there is no bent motion."""
    _, task, motion = optimised(90_100)
    turned = motion.configurations[-1].copy()
    turned[0] += 2.0 * np.pi / 3.0  # the whole arm turned about its base, through the obstacles
    assert bent_to(motion, turned, task) is None


def test_the_record_says_that_the_goal_pose_was_reached() -> None:
    """The solution's record of the goal pose is of the pose in which the motion ends."""
    solution = solve(clutter(90_103, 20).problem(), explain=False)
    record = solution.path.goal_pose
    assert record is not None
    assert record.reached
    assert record.reason == ""
    assert solution.trajectory.bend_angles[-1] == pytest.approx(record.configuration, abs=1e-6)


# ---------------------------------------------------------------- the joints that decide the duration
@settings(deadline=None, max_examples=25)
@given(st.integers(0, 2**32 - 1))
def test_busy_joints_count_more(seed: int) -> None:
    """Weights of path length and duration add up to what they were; a joint that turns more is weighed no less."""
    _, task, motion = optimised(90_100)
    rng = np.random.default_rng(seed)
    steps = rng.normal(size=motion.unknowns.shape)
    moved = replace(motion, unknowns=steps, configurations=motion.curve.configurations(steps))
    weighed = weighing_bottlenecks(moved, task)
    total = task.weights.path_length + task.weights.duration
    assert weighed.weights.path_length + weighed.weights.duration == pytest.approx(total)
    assert weighed.slowness is not None
    most = np.abs(np.diff(motion.curve.bends(moved.configurations), axis=0)).max(axis=0)
    if task.slowness is None:
        order = np.argsort(most)
        assert np.all(np.diff(weighed.slowness.speed[order]) >= -1e-12)
