"""Kinds of changes to motion or problem of a plan, with all files written anew so that they are consistent."""

import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import shapely

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.progress import Stages
from ccm_opt.driver.solution_assembly import described
from ccm_opt.driver.verified_plan import TermResults, VerifiedPlan
from ccm_opt.dynamics.runtime.inverse_dynamics import InverseDynamics, joint_states
from ccm_opt.io.folder import write_solution
from ccm_opt.problem import Problem, TipGoal
from ccm_opt.problem.solution import JointPath, JointStates, JointTrajectory, Solution
from ccm_opt.robot.base_axes import Feed
from ccm_opt.scene.bodies import BoxBody, SphereBody
from ccm_opt.scene.workspace import Obstacle, PlaneShape
from ccm_opt.verification.verifier import verify

from .plans import Folder, Generator, kind


def write_anew(
    folder: Folder, problem: Problem | None = None, trajectory: JointTrajectory | None = None, **joints: FloatArray
) -> bool:
    """Write a folder anew with another motion or problem, such that all files are consistent with them.

    Args:
        folder: the folder, changed in place.
        problem: the problem; unchanged if None.
        trajectory: the motion; unchanged if None.
        **joints: arrays of ``JointStates`` by name; by default, those that follow from the motion.
    """
    solution = folder.solution
    problem = problem or solution.problem
    trajectory = trajectory or solution.trajectory
    states = joint_states(problem.arm, trajectory, InverseDynamics(problem.arm, problem.simulation.gravity))
    states = replace(states, **joints)
    anew = told(replace(problem, source=""), solution.path, trajectory, states)
    with tempfile.TemporaryDirectory() as working:
        written = Folder.of(write_solution(anew, Path(working)), anew)
    folder.arrays = written.arrays
    folder.record = written.record
    folder.texts = written.texts
    folder.meshes = written.meshes
    return True


def told(problem: Problem, path: JointPath, trajectory: JointTrajectory, states: JointStates) -> Solution:
    """Return the solution that reports a motion, whether the motion passes the verification or not."""
    checks = verify(problem, trajectory, states)
    plan = VerifiedPlan(path, trajectory, states, checks, TermResults())
    return described(problem, plan, Stages())


def peak(values: FloatArray) -> float:
    """Return the maximum magnitude of an array."""
    return float(np.max(np.abs(values)))


@kind("pause cut out")
def _(folder: Folder, rng: Generator) -> bool:
    motion = folder.solution.trajectory
    if not motion.stops:
        return False
    stop = motion.stops[0]
    rest = int(np.argmax(np.any(motion.positions[stop:] != motion.positions[stop], axis=1))) - 1
    keep = int(rng.uniform(0.0, 0.8) * rest)
    gone = slice(stop + keep + 1, stop + rest + 1)
    late = motion.time[stop + rest] - motion.time[stop + keep]
    time = np.delete(motion.time, gone)
    time[stop + keep + 1 :] -= late
    parts = {
        name: np.delete(getattr(motion, name), gone, axis=0) for name in ("positions", "velocities", "accelerations")
    }
    return write_anew(folder, trajectory=replace(motion, time=time, **parts))


@kind("accelerations weakened where a torque is greatest")
def _(folder: Folder, rng: Generator) -> bool:
    solution = folder.solution
    motion = solution.trajectory
    at, joint = np.unravel_index(np.argmax(np.abs(solution.joints.torques)), solution.joints.torques.shape)
    held = solution.joints.torques.copy()
    rest = replace(motion, velocities=0.0 * motion.velocities, accelerations=0.0 * motion.accelerations)
    arm = solution.problem.arm
    held = joint_states(arm, rest, InverseDynamics(arm, solution.problem.simulation.gravity)).torques
    top = peak(solution.joints.torques)
    # Where gravity takes most of it there is nothing to be hidden by accelerations.
    if abs(abs(held[at, joint]) - top) < 0.2 * top:
        return False
    weak = motion.accelerations.copy()
    weak[max(at - 4, 0) : at + 5] *= rng.uniform(0.0, 0.4)
    limits = replace(solution.problem.limits, torque=np.full(3 * arm.links, 0.9 * top))
    problem = replace(solution.problem, limits=limits, planner=replace(solution.problem.planner, effort_share=1.0))
    return write_anew(folder, problem, replace(motion, accelerations=weak))


@kind("a tighter limit of the drives")
def _(folder: Folder, rng: Generator) -> bool:
    solution = folder.solution
    limits = solution.problem.limits
    share = rng.uniform(0.5, 0.98)
    reached = {
        "velocity": solution.joints.velocities,
        "acceleration": solution.joints.accelerations,
        "torque": solution.joints.torques,
        "jerk": np.diff(solution.joints.accelerations, axis=0) / np.diff(solution.trajectory.time)[:, None],
        "feed_velocity": solution.trajectory.base_velocities,
        "feed_acceleration": solution.trajectory.base_accelerations,
        "feed_force": solution.joints.base_forces,
    }
    names = [name for name in sorted(reached) if getattr(limits, name) is not None]
    name = names[int(rng.integers(len(names)))]
    bound = share * peak(reached[name])
    value = bound if name.startswith("feed") else np.full(3 * solution.problem.arm.links, bound)
    planner = replace(solution.problem.planner, effort_share=1.0)
    return write_anew(folder, replace(solution.problem, limits=replace(limits, **{name: value}), planner=planner))


@kind("a tighter limit of a point")
def _(folder: Folder, rng: Generator) -> bool:
    limits = folder.solution.problem.limits
    if not limits.points:
        return False
    tight = [replace(point, velocity=rng.uniform(0.1, 0.5) * point.velocity) for point in limits.points]
    moved = [point for point in tight if np.isfinite(point.velocity)]
    speeds = {check.name: check.worst for check in folder.solution.checks}
    if all(speeds[f"{point.name} velocity"] < point.velocity for point in moved):
        return False
    return write_anew(folder, replace(folder.solution.problem, limits=replace(limits, points=tuple(tight))))


@kind("a smaller share of the limits")
def _(folder: Folder, rng: Generator) -> bool:
    problem = folder.solution.problem
    planner = replace(problem.planner, effort_share=rng.uniform(0.3, 0.8))
    return write_anew(folder, replace(problem, planner=planner))


@kind("a tighter joint limit")
def _(folder: Folder, rng: Generator) -> bool:
    problem = folder.solution.problem
    most = peak(folder.solution.trajectory.bend_angles[:, 1:])
    return write_anew(folder, replace(problem, arm=replace(problem.arm, joint_limit=rng.uniform(0.5, 0.99) * most)))


@kind("a larger clearance")
def _(folder: Folder, rng: Generator) -> bool:
    problem = folder.solution.problem
    least = next(check.worst for check in folder.solution.checks if check.name == "wall clearance")
    workspace = replace(problem.workspace, clearance=least + rng.uniform(2e-6, 0.01))
    return write_anew(folder, replace(problem, workspace=workspace))


@kind("an obstacle in the way")
def _(folder: Folder, rng: Generator) -> bool:
    problem = folder.solution.problem
    points = folder.solution.joint_positions
    sample = int(rng.integers(len(points)))
    place = points[sample, int(rng.integers(2, points.shape[1]))]
    if problem.dimension == 3:
        bodies = (*problem.workspace.obstacles, Obstacle("speck", SphereBody(place, 0.002)))
        return write_anew(folder, replace(problem, workspace=replace(problem.workspace, obstacles=bodies)))
    speck = Obstacle("speck", PlaneShape(shapely.Point(place), 0.002))
    workspace = replace(problem.workspace, obstacles=(*problem.workspace.obstacles, speck))
    return write_anew(folder, replace(problem, workspace=workspace))


@kind("another goal")
def _(folder: Folder, rng: Generator) -> bool:
    problem = folder.solution.problem
    goal = problem.goal
    if not isinstance(goal, TipGoal):
        return False
    way = rng.normal(size=len(goal.position))
    away = rng.uniform(1.5, 20.0) * problem.tolerances.position * way / np.linalg.norm(way)
    return write_anew(folder, replace(problem, goal=replace(goal, position=goal.position + away)))


@kind("another direction at the goal")
def _(folder: Folder, rng: Generator) -> bool:
    problem = folder.solution.problem
    goal = problem.goal
    if problem.dimension == 2 or not isinstance(goal, TipGoal) or goal.direction is None:
        return False
    aside = np.cross(goal.direction, rng.normal(size=3))
    angle = rng.uniform(1.5, 40.0) * problem.tolerances.heading
    turned = goal.direction + np.tan(angle) * aside / np.linalg.norm(aside)
    return write_anew(folder, replace(problem, goal=replace(goal, direction=turned / np.linalg.norm(turned))))


@kind("a place on the way that is not passed")
def _(folder: Folder, rng: Generator) -> bool:
    problem = folder.solution.problem
    goal = problem.goal
    if problem.dimension == 2 or not isinstance(goal, TipGoal):
        return False
    way = rng.normal(size=3)
    tip = folder.solution.joint_positions[:, -1]
    place = goal.position + rng.uniform(0.2, 0.6) * way / np.linalg.norm(way)
    if np.min(np.linalg.norm(tip - place, axis=1)) < 1.1 * problem.arm.link_length:
        return False
    return write_anew(folder, replace(problem, goal=replace(goal, via=(place,))))


@kind("a body about the arm's base")
def _(folder: Folder, rng: Generator) -> bool:
    problem = folder.solution.problem
    if problem.dimension == 2:
        return False
    half = np.full(3, rng.uniform(2.0, 3.0))  # all of the motion is inside
    around = Obstacle("around", BoxBody(problem.arm.base - half, problem.arm.base + half))
    workspace = replace(problem.workspace, bounds=None, obstacles=(*problem.workspace.obstacles, around))
    return write_anew(folder, replace(problem, workspace=workspace))


@kind("a motion in less time")
def _(folder: Folder, rng: Generator) -> bool:
    motion = folder.solution.trajectory
    f = 1.0 + rng.uniform(0.1, 1.0)
    faster = replace(
        motion, time=motion.time / f, velocities=f * motion.velocities, accelerations=f**2 * motion.accelerations
    )
    return write_anew(folder, trajectory=faster)


@kind("one sample elsewhere")
def _(folder: Folder, rng: Generator) -> bool:
    motion = folder.solution.trajectory
    positions = motion.positions.copy()
    sample = int(rng.integers(1, len(positions) - 1))
    positions[sample, int(rng.integers(positions.shape[1]))] += rng.choice([-1.0, 1.0]) * rng.uniform(0.01, 0.3)
    return write_anew(folder, trajectory=replace(motion, positions=positions))


@kind("an end that does not rest")
def _(folder: Folder, rng: Generator) -> bool:
    motion = folder.solution.trajectory
    last = int(rng.integers(len(motion.time) // 2, len(motion.time) - 3))
    return write_anew(folder, trajectory=motion.part(slice(0, last)))


@kind("a shorter feed axis")
def _(folder: Folder, rng: Generator) -> bool:
    problem = folder.solution.problem
    feed = problem.arm.feed
    if feed is None:
        return False
    high = peak(folder.solution.trajectory.base_positions) - rng.uniform(1e-4, 0.05)
    arm = replace(problem.arm, feed=Feed(feed.low, high, feed.hole))
    return write_anew(folder, replace(problem, arm=arm))


@kind("a longer guide tube")
def _(folder: Folder, rng: Generator) -> bool:
    problem = folder.solution.problem
    feed = problem.arm.feed
    if feed is None:
        return False
    arm = replace(problem.arm, feed=Feed(feed.low, feed.high, feed.hole + rng.uniform(0.1, 0.3)))
    return write_anew(folder, replace(problem, arm=arm))


@kind("an error to survive that is too large")
def _(folder: Folder, rng: Generator) -> bool:
    del rng
    if folder.solution.problem.dimension == 3:
        return False
    return write_anew(folder, replace(folder.solution.problem, joint_error=0.3))
