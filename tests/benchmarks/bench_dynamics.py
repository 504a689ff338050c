"""Times of our dynamics beside Pinocchio's and MuJoCo's, in one run: ``python -m tests.benchmarks.bench_dynamics``.

User CPU of one process, medians of seven rounds. Read the ratios: all rows of a table share the machine's state. Set
OMP_NUM_THREADS=1. The table ``frames`` runs the paper's loop of section 5.1 with a picture a frame, by matplotlib.
"""
# ruff: noqa: T201 - a script of its own that prints its tables

import argparse
import resource
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from statistics import median

import mujoco
import numpy as np
import pinocchio as pin
import pytest

from ccm_opt import load_problem, solve
from ccm_opt.core import native
from ccm_opt.core.arrays import FloatArray
from ccm_opt.dynamics.algorithms.arm_model import arm_model
from ccm_opt.dynamics.runtime.inverse_dynamics import (
    DynamicsFunction,
    ForwardDynamics,
    InverseDynamics,
    MassMatrix,
    joint_states,
)
from ccm_opt.dynamics.simulation import closed_loop_run as simulation
from ccm_opt.dynamics.simulation.closed_loop_run import simulate, simulated_states
from ccm_opt.io.mjcf_models import mjcf_text
from ccm_opt.io.urdf_models import urdf_text
from ccm_opt.problem import SimulationOptions
from ccm_opt.problem.solution import Solution
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.base_axes import Feed
from ccm_opt.robot.frames import joint_positions_3d, revolute_angles
from ccm_opt.robot.inverse_kinematics import ball_angles
from hatch_build import build
from tests.benchmarks.arm_view import ArmView
from tests.dynamics_arms import loose_limits, random_states, smooth_trajectory, swan_neck

GRAVITY = np.array([0.0, 0.0, -9.81])
ROUNDS = 7
REPEATS = 20_000
PROBLEM = Path(__file__).parents[2] / "problems" / "swan-neck.toml"


def user_cpu(who: int = resource.RUSAGE_SELF) -> float:
    """User CPU time so far [s]."""
    return resource.getrusage(who).ru_utime


def microseconds(call: Callable[[], object], repeats: int) -> float:
    """Median user CPU of one call [µs]."""
    call()
    rounds = []
    for _ in range(ROUNDS):
        start = user_cpu()
        for _ in range(repeats):
            call()
        rounds.append((user_cpu() - start) / repeats)
    return 1e6 * median(rounds)


def interleaved(calls: Mapping[str, tuple[Callable[[], object], int]]) -> dict[str, list[float]]:
    """User CPU of calls in every round [µs]; rounds go through all calls, so that all meet the same load.

    Args:
        calls: for every name what is called, and how many states one call is for.
    """
    times: dict[str, list[float]] = {name: [] for name in calls}
    for _ in range(ROUNDS):
        for name, (call, states) in calls.items():
            call()
            repeats = max(1, REPEATS // states)
            start = user_cpu()
            for _ in range(repeats):
                call()
            times[name].append(1e6 * (user_cpu() - start) / (repeats * states))
    return times


def compare_calls(links: int = 12, count: int = 1000) -> None:
    """One state at a time, at 36 joints."""
    arm = swan_neck(links)
    q, v, w = (states[0].copy() for states in random_states(3 * links))
    inverse = InverseDynamics(arm, GRAVITY)
    forward = ForwardDynamics(arm, GRAVITY)
    tau = inverse(q, v, w)
    model = pin.buildModelFromXML(urdf_text(arm, "arm", loose_limits(arm)))
    data = model.createData()
    mj_model = mujoco.MjModel.from_xml_string(mjcf_text(arm, "arm", GRAVITY))
    mj_data = mujoco.MjData(mj_model)
    mj_data.qpos[:] = q
    mj_data.qvel[:] = v
    mj_data.qfrc_applied[:] = tau
    many = [np.tile(x, (count, 1)) for x in (q, v, w)]
    times = interleaved(
        {
            "RNEA, one call": (lambda: inverse(q, v, w), 1),
            "RNEA, per state of a batch": (lambda: inverse(*many), count),
            "RNEA, Pinocchio": (lambda: pin.rnea(model, data, q, v, w), 1),
            "ABA, one call": (lambda: forward(q, v, tau), 1),
            "ABA, per state of a batch": (lambda: forward(*many), count),
            "ABA, Pinocchio": (lambda: pin.aba(model, data, q, v, tau), 1),
            "mj_forward, one call": (lambda: mujoco.mj_forward(mj_model, mj_data), 1),
        }
    )
    print(f"{3 * links} joints, from Python [µs]; median ratio to Pinocchio's, for ABA also to mj_forward's")
    for name, values in times.items():
        others = ["RNEA, Pinocchio"] if name.startswith("RNEA") else ["ABA, Pinocchio", "mj_forward, one call"]
        ratios = [median(a / b for a, b in zip(values, times[other], strict=True)) for other in others]
        print(f"  {name:28s} {median(values):8.2f}  " + "".join(f"{ratio:8.3f}" for ratio in ratios))


def compare_sines(count: int = 1000) -> None:
    """Our sines of all angles at once beside the C library's, in libraries that differ in nothing else."""
    print("\nSines: with the C library's sin and cos, a state of a batch of 36 joints takes")
    arm = swan_neck(12)
    with tempfile.TemporaryDirectory() as folder, pytest.MonkeyPatch.context() as patch:
        other = Path(folder) / native.LIBRARY.name
        build(other, Path(folder) / "objects", ("-DFAR=-1.0",))  # with -1 every angle is too far for our reduction
        model = arm_model(arm, GRAVITY)
        for kind in ("inverse_dynamics", "forward_dynamics"):
            ours = DynamicsFunction(kind, model)
            native.native_library.cache_clear()
            patch.setattr(native, "LIBRARY", other)
            theirs = DynamicsFunction(kind, model)
            patch.undo()
            native.native_library.cache_clear()
            states = random_states(36, count)
            times = interleaved(
                {
                    "ours": (lambda f=ours, x=states: f.of_joints(*x), count),
                    "theirs": (lambda f=theirs, x=states: f.of_joints(*x), count),
                }
            )
            ratio = median(b / a for a, b in zip(times["ours"], times["theirs"], strict=True))
            figures = f"{median(times['theirs']):.2f} µs for {median(times['ours']):.2f}"
            print(f"  {kind.replace('_', ' ')}: {ratio:.2f} times as long ({figures})")


def batched(function: DynamicsFunction, links: int, count: int = 1000) -> float:
    """Time for a state of a batch [µs]."""
    states = (0.5 if links > 50 else 1.0) * random_states(3 * links, count)
    return microseconds(lambda: function.with_feed(*states), max(1, 1200 // links)) / count


def compare_lengths() -> None:
    """Time per joint for longer arms, and how long everything takes to be ready."""
    print("\nPer state of a batch [ns a joint], and time until all is ready [s of user CPU]")
    print("  joints    RNEA     ABA    ready")
    base = None
    for links in (12, 24, 96, 384):
        warm = ready(links)
        arm = swan_neck(links)
        inverse = InverseDynamics(arm, GRAVITY)
        forward = ForwardDynamics(arm, GRAVITY)
        times = [1e3 * batched(f, links) / (3 * links) for f in (inverse._rnea, forward._aba)]
        base = base or times
        ratios = ", ".join(f"{time / first:.2f}" for time, first in zip(times, base, strict=True))
        print(f"  {3 * links:6d} {times[0]:7.1f} {times[1]:7.1f} {warm:8.2f}   x {ratios}")


def ready(links: int) -> float:
    """User CPU until inverse and forward dynamics, mass matrix and closed loop can be called [s]."""
    start = user_cpu()
    arm = swan_neck(links)
    InverseDynamics(arm, GRAVITY)
    ForwardDynamics(arm, GRAVITY)
    MassMatrix(arm)
    simulation.closed_loop(arm, arm, SimulationOptions(gravity=GRAVITY), loose_limits(arm))
    return user_cpu() - start


def compare_simulation() -> None:
    """Closed loop of two seconds at 1 ms."""
    print("\nSimulation of 2 s at 1 ms, computed torque, warm cache [s of user CPU]")
    print("  joints   joint states   simulate   x real time   error [rad]")
    for links in (12, 24, 48, 96, 200):
        simulation_row(links)


def simulation_row(links: int) -> None:
    """One row of the table above."""
    arm = swan_neck(links)
    trajectory = smooth_trajectory(0.4 * np.sin(np.arange(links)) * 12 / links, duration=2.0)
    joints = joint_states(arm, trajectory, InverseDynamics(arm, GRAVITY))
    options = SimulationOptions(gravity=GRAVITY)
    limits = loose_limits(arm)
    motion = simulate(arm, trajectory, joints, options, limits)
    warm = microseconds(lambda: simulate(arm, trajectory, joints, options, limits), 1) * 1e-6
    states = microseconds(lambda: joint_states(arm, trajectory, InverseDynamics(arm, GRAVITY)), 1) * 1e-6
    print(f"  {3 * links:6d} {states:14.4f} {warm:10.4f} {2.0 / warm:13.0f} {motion.tracking_error:13.1e}")


def compare_energy() -> None:
    """Drift of the total energy of a free fall of 0.6 s from level at 1 ms, ours and MuJoCo's Runge–Kutta."""
    arm = replace(swan_neck(12), base_heading=0.0)
    limits = loose_limits(arm, torque=0.0)
    joints = 36
    loop = simulation.closed_loop(arm, arm, SimulationOptions(gravity=GRAVITY), limits)
    rest = np.zeros((600, 3, joints + 1))
    states = loop.run(rest[0, :2], rest, rest[:, :2, :-1], 0)[0]
    model = mujoco.MjModel.from_xml_string(mjcf_text(arm, "arm", GRAVITY))
    model.jnt_limited[:] = 0
    data = mujoco.MjData(model)
    theirs = []
    for _ in range(600):
        mujoco.mj_step(model, data)
        theirs.append(np.stack((data.qpos, data.qvel)))
    ours, mujocos = (drift_of(arm, motion) for motion in (states[:, :, :-1], np.array(theirs)))
    print("\nFree fall of 0.6 s at 1 ms, energy drift at the end, and the largest on the way [J]")
    print(f"  {ours[0]:.3e}, {ours[1]:.3e}; MuJoCo's Runge-Kutta {mujocos[0]:.3e}, {mujocos[1]:.3e}")


def drift_of(arm: Arm, states: FloatArray) -> tuple[float, float]:
    """Change of kinetic and potential energy from rest to the end, and the largest of every tenth state [J]."""
    mass_matrix = MassMatrix(arm)
    energies = []
    for q, v in (np.zeros((2, states.shape[2])), *states[9::10]):
        points = joint_positions_3d(arm, q)
        height = 0.5 * (points[:-1, 2] + points[1:, 2])
        energies.append(0.5 * v @ mass_matrix(q) @ v + 9.81 * np.sum(arm.masses * height))
    change = np.abs(np.array(energies) - energies[0])
    return float(change[-1]), float(np.max(change))


def compare_frames(solution: Solution, rate: float = 60.0) -> None:
    """The loop of section 5.1 along a plan: state of the next interval, inverse kinematics, dynamics, drawing.

    The plan and its timing are at hand (steps 2 and 4); every frame simulates 1/60 s, finds the angles of the planned
    joint positions (step 3) and draws the arm in 3-D from the simulated ones (step 6).
    """
    problem = solution.problem
    arm = problem.arm
    view = ArmView(problem.arm)
    positions = solution.joint_positions
    setup = (arm, solution.trajectory, solution.joints, problem.simulation, problem.limits)
    frames = 0
    start = user_cpu()
    for time, angles, base in simulated_states(*setup, 1.0 / rate):
        sample = min(int(np.searchsorted(solution.trajectory.time, time)), len(positions) - 1)
        ball_angles(arm, positions[sample])
        view.show(joint_positions_3d(arm, angles, base))
        frames += 1
    spent = user_cpu() - start
    points = joint_positions_3d(arm, revolute_angles(arm, solution.trajectory.bend_angles[-1]))
    draw = 1e-3 * microseconds(lambda: view.show(points), 50)
    print(f"\nLoop of section 5.1 on {problem.name}: {frames / spent:.0f} frames a second, {frames} of 1/{rate:g} s")
    print(f"  of a frame's {1e3 * spent / frames:.2f} ms drawing takes {draw:.2f} ms; the paper's: about 5 a second")
    print(f"  tracking error {solution.simulation.tracking_error:.1e} rad, saturated: {solution.simulation.saturated}")


def compare_feed() -> None:
    """What a feed axis costs the closed loop."""
    arm = swan_neck(12)
    trajectory = smooth_trajectory(0.4 * np.sin(np.arange(12.0)), duration=2.0)
    times = []
    for moved in (arm, replace(arm, feed=Feed(0.0, 0.4, 0.4))):
        joints = joint_states(moved, trajectory, InverseDynamics(moved, GRAVITY))
        setup = (moved, trajectory, joints, SimulationOptions(gravity=GRAVITY), loose_limits(moved))
        times.append(microseconds(lambda setup=setup: simulate(*setup), 1))
    print(f"  with a feed axis the closed loop of 36 joints takes {times[1] / times[0]:.2f} times as long")


def compare_swan() -> None:
    """The swan's neck: frames of the paper's loop a second."""
    compare_frames(solve(load_problem(PROBLEM)))


TABLES = {
    "calls": compare_calls,
    "sines": compare_sines,
    "simulation": compare_simulation,
    "feed": compare_feed,
    "energy": compare_energy,
    "frames": compare_swan,
    "lengths": compare_lengths,
}


def main() -> None:
    """Print the tables that are asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("tables", nargs="*", metavar="table", help=f"{', '.join(TABLES)}; all when left out")
    for table in parser.parse_args().tables or TABLES:
        TABLES[table]()


if __name__ == "__main__":
    main()
