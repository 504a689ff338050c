"""A correct timed motion of an arm in space among several bodies, for tests of the verifier."""

from dataclasses import dataclass, replace
from functools import cache, partial

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.dynamics.retiming import retime
from ccm_opt.dynamics.runtime.inverse_dynamics import InverseDynamics, joint_states
from ccm_opt.problem import JointPose, Problem, SimulationOptions, TipGoal, Tolerances
from ccm_opt.problem.solution import Check, JointStates, JointTrajectory
from ccm_opt.robot.base_axes import Feed
from ccm_opt.robot.coordinates import Limits, PointLimit
from ccm_opt.robot.frames import revolute_angles
from ccm_opt.scene.bodies import BOX_FACES, BoxBody, CapsuleBody, CylinderBody, MeshBody, SphereBody, box_corners
from ccm_opt.scene.workspace import Obstacle, Workspace
from ccm_opt.verification.chain_motion import LinkFrames, chain_points
from ccm_opt.verification.verifier import verify

from .retiming_paths import make_path
from .space_arms import space_arm

GRAVITY = np.array([0.0, 0.0, -9.81])


@dataclass(frozen=True)
class SpacePlan:
    """Timed motion of an arm in space, and the problem that the motion solves.

    Attributes:
        problem: the problem.
        trajectory: the motion.
        joints: states and efforts of the drives in this motion.
    """

    problem: Problem
    trajectory: JointTrajectory
    joints: JointStates

    def checks(self) -> tuple[Check, ...]:
        """Return the results of the verifier."""
        return verify(self.problem, self.trajectory, self.joints)

    def failed(self) -> list[str]:
        """Return the names of the failed checks."""
        return [check.name for check in self.checks() if not check.passed]

    def asking(self, **changes: object) -> "SpacePlan":
        """Return an unchanged motion with a problem in which given fields are replaced."""
        return replace(self, problem=replace(self.problem, **changes))  # type: ignore[arg-type]

    def moving(self, **changes: object) -> "SpacePlan":
        """Return a motion with given fields of the trajectory replaced, and the corresponding states of the drives."""
        trajectory = replace(self.trajectory, **changes)  # type: ignore[arg-type]
        dynamics = InverseDynamics(self.problem.arm, self.problem.simulation.gravity)
        return replace(self, trajectory=trajectory, joints=joint_states(self.problem.arm, trajectory, dynamics))


@cache
def true_plan() -> SpacePlan:
    """Return a correct motion of an arm of eight links on a feed axis among five bodies, with a via point."""
    arm = space_arm(8, feed=Feed(0.0, 0.5, 0.0), rotor_inertia=1e-3, friction=0.01, payload=0.05)
    n = 3 * arm.links
    points = (PointLimit(None, 0.6, 3.0), PointLimit(0.35, 0.4, 2.0))
    limits = Limits(np.full(n, 1.0), np.full(n, 5.0), np.full(n, 20.0), 0.1, 0.5, 100.0, points=points)
    columns = 0.25 * np.sin(np.arange(17) + 2.0 * np.linspace(0.0, 1.0, 6)[:, None])
    columns[:, 16] = np.linspace(0.1, 0.4, 6)
    path = make_path(columns)
    dynamics = InverseDynamics(arm, GRAVITY)
    trajectory = retime(
        path, limits, dynamics, revolutes=partial(revolute_angles, arm), coordinates=arm.coordinates, arm=arm, share=0.9
    )
    last = trajectory.positions[-1:]
    tip = chain_points(arm, trajectory.positions)[:, -1]
    goal = TipGoal(tip[-1], LinkFrames.from_configurations(arm, last).along[0, -1], via=(tip[len(tip) // 2],))
    workspace = Workspace(bounds=np.array([[-0.5, -1.0, -1.0], [1.6, 1.0, 1.0]]), obstacles=bodies(), clearance=0.005)
    start = JointPose.from_configuration(trajectory.positions[0], arm.coordinates)
    problem = Problem("true", workspace, arm, limits, start, goal, tolerances=Tolerances(1e-3, 0.01))
    problem = replace(problem, simulation=SimulationOptions(gravity=GRAVITY))
    problem = replace(problem, planner=replace(problem.planner, effort_share=0.9))
    return SpacePlan(problem, trajectory, joint_states(arm, trajectory, dynamics))


def bodies() -> tuple[Obstacle, ...]:
    """Return one obstacle of each of five kinds of bodies, none of them on the path of the arm."""
    low, high = np.array([0.2, 0.6, -0.2]), np.array([0.4, 0.8, 0.2])
    corners = box_corners(low - [0.0, 1.5, 0.0], high - [0.0, 1.5, 0.0])
    return (
        Obstacle("box", BoxBody(low, high)),
        Obstacle("ball", SphereBody(np.array([0.5, 0.0, 0.8]), 0.1)),
        Obstacle("bar", CapsuleBody(np.array([1.4, -0.5, -0.6]), np.array([1.4, 0.5, -0.6]), 0.05)),
        Obstacle("tube", CylinderBody(np.array([0.3, -0.5, -0.8]), np.array([0.9, 0.5, -0.8]), 0.05)),
        Obstacle("mesh", MeshBody(corners, BOX_FACES)),
    )


def with_body(plan: SpacePlan, name: str, body: BoxBody | SphereBody | MeshBody) -> SpacePlan:
    """Return a plan with an unchanged motion and one more obstacle in the workspace."""
    workspace = plan.problem.workspace
    return plan.asking(workspace=replace(workspace, obstacles=(*workspace.obstacles, Obstacle(name, body))))


def places_of(plan: SpacePlan) -> FloatArray:
    """Return the positions of joints and tip at the T samples of a plan, shape (T, links + 1, 3) [m]."""
    return chain_points(plan.problem.arm, plan.trajectory.positions)
