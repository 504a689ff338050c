"""CPU time of the independent verifier: 24 and 96 links swing in a room of 60 obstacles; run this file as a script."""

import statistics
import time

import numpy as np
import shapely

from ccm_opt.problem import JointPose, Limits, Problem
from ccm_opt.problem.solution import JointStates, JointTrajectory
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.frames import joint_names, revolute_angles
from ccm_opt.scene.workspace import Obstacle, PlaneShape, Workspace
from ccm_opt.verification.verifier import verify
from tests.arms import joint_torques, plain_arm


def make_case(links: int, samples: int = 1001, duration: float = 4.0) -> tuple[Problem, JointTrajectory, JointStates]:
    """A one-metre arm that swings and curls, with obstacles as near to its sweep as they may stand."""
    arm = plain_arm(links, 1.0 / links, joint_limit=1.3, mount_length=0.02)
    trajectory = swing(arm, samples, duration)
    workspace = make_clutter(arm, trajectory, 60)
    limits = Limits(np.full(3 * links, 2.0), np.full(3 * links, 10.0), np.full(3 * links, 50.0))
    bends = trajectory.bend_angles
    problem = Problem("bench", workspace, arm, limits, JointPose(bends[0]), JointPose(bends[-1]))
    rates = trajectory.bend_velocities
    growth = trajectory.bend_accelerations
    torques = joint_torques(arm, problem.simulation.gravity, bends, rates, growth)
    angles, velocities, accelerations = (revolute_angles(arm, values) for values in (bends, rates, growth))
    return problem, trajectory, JointStates(joint_names(arm), angles, velocities, accelerations, torques)


def swing(arm: Arm, samples: int, duration: float) -> JointTrajectory:
    """Rest to rest by a quintic, from a wave to a curl."""
    t = np.linspace(0.0, 1.0, samples)
    s = np.stack(
        (10 * t**3 - 15 * t**4 + 6 * t**5, 30 * t**2 - 60 * t**3 + 30 * t**4, 60 * t - 180 * t**2 + 120 * t**3)
    )
    wave = 0.3 * 24 / arm.links * np.sin(np.linspace(0.0, 6.0, arm.links))
    curl = 5.0 / arm.links * np.ones(arm.links)
    bends, rates, growth = (value[:, None] * (curl - wave) for value in s)
    return JointTrajectory(t * duration, wave + bends, rates / duration, growth / duration**2)


def make_clutter(arm: Arm, trajectory: JointTrajectory, count: int) -> Workspace:
    """Random pentagons within some centimetres of the arm's sweep, which leaves them free by 1 mm or more."""
    rng = np.random.default_rng(0)
    points = arm.joint_positions(arm.headings(trajectory.bend_angles[::5]))
    sweep = shapely.union_all(shapely.buffer(shapely.linestrings(points), arm.radius + 0.001, quad_segs=32))
    obstacles: list[Obstacle] = []
    while len(obstacles) < count:
        centre = rng.choice(points.reshape(-1, 2)) + rng.uniform(-0.15, 0.15, 2)
        size = rng.uniform(0.01, 0.06)
        turn = rng.uniform(0.0, 6.0) + np.arange(5) * 1.2566
        core = shapely.Polygon(centre + size * np.stack((np.cos(turn), np.sin(turn)), axis=1))
        if shapely.disjoint(core, sweep):
            obstacles.append(Obstacle(f"obstacle {len(obstacles) + 1}", PlaneShape(core)))
    return Workspace(shapely.box(-1.5, -1.5, 1.5, 1.5), tuple(obstacles))


def main() -> None:
    """Print median CPU times."""
    for links in (24, 96):
        case = make_case(links)
        times = []
        for _ in range(5):
            begin = time.process_time()
            checks = verify(*case)
            times.append(time.process_time() - begin)
        print(f"{links} links: {statistics.median(times):.3f} s CPU")  # noqa: T201
        print("\n".join(f"  {check}" for check in checks))  # noqa: T201


if __name__ == "__main__":
    main()
