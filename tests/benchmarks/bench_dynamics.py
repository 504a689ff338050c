"""Times of our dynamics beside Pinocchio's and MuJoCo's, all in one run: ``python tests/benchmarks/bench_dynamics.py``.

User CPU of one process, medians of seven rounds. Read the ratios: all rows of a table share the machine's state. Set
OMP_NUM_THREADS=1.
"""
# ruff: noqa: T201 - a script of its own that prints its tables

import os
import resource
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from statistics import median

import mujoco
import numpy as np
import pinocchio as pin

sys.path.insert(0, str(Path(__file__).parents[2]))

from ccm_opt.dynamics import compiled
from ccm_opt.dynamics.forward_dynamics import ForwardDynamics
from ccm_opt.dynamics.inverse_dynamics import InverseDynamics, joint_states
from ccm_opt.dynamics.simulation import simulate
from ccm_opt.export.mjcf import mjcf_text
from ccm_opt.export.urdf import urdf_text
from ccm_opt.problem import SimulationOptions
from tests.dynamics_arms import loose_limits, make_arm, random_states, smooth_trajectory

GRAVITY = np.array([0.0, 0.0, -9.81])
ROUNDS = 7


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


def compare_calls(links: int = 12, repeats: int = 20_000) -> None:
    """One state at a time, at 36 joints."""
    arm = make_arm(links)
    q, v, w = (states[0] for states in random_states(3 * links))
    inverse, forward = InverseDynamics(arm, GRAVITY), ForwardDynamics(arm, GRAVITY)
    tau = inverse(q, v, w)
    model = pin.buildModelFromXML(urdf_text(arm, "arm", loose_limits(arm)))
    data = model.createData()
    mj_model = mujoco.MjModel.from_xml_string(mjcf_text(arm, "arm", GRAVITY))
    mj_data = mujoco.MjData(mj_model)
    mj_data.qpos[:], mj_data.qvel[:], mj_data.qfrc_applied[:] = q, v, tau
    many = [np.tile(x, (1000, 1)) for x in (q, v, w, tau)]
    rows = {
        "RNEA, one call": microseconds(lambda: inverse(q, v, w), repeats),
        "RNEA, buffers alone": microseconds(inverse._rnea._single._evaluate, repeats),
        "RNEA, per state of a batch": microseconds(lambda: inverse(*many[:3]), repeats // 500) / 1000,
        "RNEA, Pinocchio": microseconds(lambda: pin.rnea(model, data, q, v, w), repeats),
        "ABA, one call": microseconds(lambda: forward(q, v, tau), repeats),
        "ABA, buffers alone": microseconds(forward._aba._single._evaluate, repeats),
        "ABA, per state of a batch": microseconds(lambda: forward(many[0], many[1], many[3]), repeats // 500) / 1000,
        "ABA, Pinocchio": microseconds(lambda: pin.aba(model, data, q, v, tau), repeats),
        "mj_forward, one call": microseconds(lambda: mujoco.mj_forward(mj_model, mj_data), repeats),
    }
    print(f"{3 * links} joints, from Python [µs]")
    for name, value in rows.items():
        reference = rows["RNEA, Pinocchio" if name.startswith("RNEA") else "ABA, Pinocchio"]
        print(f"  {name:28s} {value:8.2f}   Pinocchio / this {reference / value:6.2f}")


def compare_simulation(links: int) -> None:
    """Closed loop of two seconds: first time with an empty cache, then warm."""
    arm = make_arm(links)
    trajectory = smooth_trajectory(0.4 * np.sin(np.arange(links)) * 12 / links, duration=2.0)
    children, own = user_cpu(resource.RUSAGE_CHILDREN), user_cpu()
    joints = joint_states(arm, trajectory, InverseDynamics(arm, GRAVITY))
    options, limits = SimulationOptions(gravity=GRAVITY), loose_limits(arm)
    motion = simulate(arm, trajectory, joints, options, limits)
    gcc, first = user_cpu(resource.RUSAGE_CHILDREN) - children, user_cpu() - own
    warm = microseconds(lambda: simulate(arm, trajectory, joints, options, limits), 1) * 1e-6
    states = microseconds(lambda: joint_states(arm, trajectory, InverseDynamics(arm, GRAVITY)), 1) * 1e-6
    print(
        f"  {3 * links:6d} {gcc:10.2f} {first:10.2f} {states:14.4f} {warm:10.4f} {2.0 / warm:12.0f}"
        f" {motion.tracking_error:12.1e}"
    )


def main() -> None:
    """Print both tables; compile into a folder of its own."""
    with tempfile.TemporaryDirectory() as folder:
        os.environ[compiled.CACHE_VARIABLE] = folder
        compare_calls()
        print("\nSimulation of 2 s at 1 ms, computed torque [s of user CPU]")
        print("  joints compiler first, own joint states warm, simulate  x real time  error [rad]")
        for links in (12, 24, 48, 96, 200):
            compare_simulation(links)


if __name__ == "__main__":
    main()
