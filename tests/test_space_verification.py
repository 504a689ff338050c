"""The verifier in space: true plans pass, untrue ones are refused by the check that is meant to see them."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.problem import JointPose, Stop, TipGoal
from ccm_opt.robot.base_axes import Feed
from ccm_opt.robot.coordinates import PointLimit
from ccm_opt.scene.bodies import BOX_FACES, BoxBody, MeshBody, SphereBody, box_corners
from ccm_opt.verification.verification_settings import DEFAULT_VERIFICATION

from .space_plans import SpacePlan, places_of, true_plan, with_body

Change = Callable[[SpacePlan], SpacePlan]


def test_a_true_plan_passes() -> None:
    """Every check of a plan that is true holds, and there is one for every promise."""
    checks = true_plan().checks()
    assert all(check.passed for check in checks)
    names = {check.name for check in checks}
    for promise in ("wall clearance", "self-collision", "joint limit", "joint torque", "tip velocity", "feed range"):
        assert promise in names
    assert {"goal position", "goal direction", "goal via 1", "start joints", "joints inside the guide"} <= names


def middle_link(plan: SpacePlan) -> FloatArray:
    """The middle of a link halfway through the motion."""
    places = places_of(plan)
    return np.asarray(0.5 * (places[len(places) // 2, 5] + places[len(places) // 2, 6]))


def limits(plan: SpacePlan, **changes: object) -> SpacePlan:
    """The same with other limits."""
    return plan.asking(limits=replace(plan.problem.limits, **changes))  # type: ignore[arg-type]


def arm(plan: SpacePlan, **changes: object) -> SpacePlan:
    """The same for another arm."""
    return plan.asking(arm=replace(plan.problem.arm, **changes))  # type: ignore[arg-type]


def goal(plan: SpacePlan, **changes: object) -> SpacePlan:
    """The same for another goal."""
    assert isinstance(plan.problem.goal, TipGoal)
    return plan.asking(goal=replace(plan.problem.goal, **changes))  # type: ignore[arg-type]


def beside(plan: SpacePlan) -> FloatArray:
    """A place beside the goal, twice the tolerance away."""
    assert isinstance(plan.problem.goal, TipGoal)
    return np.asarray(plan.problem.goal.position + np.array([0.0, 2e-3, 0.0]))


def reported(plan: SpacePlan, **changes: object) -> SpacePlan:
    """Another report of the motion, the drives as they were."""
    return replace(plan, trajectory=replace(plan.trajectory, **changes))  # type: ignore[arg-type]


def driven(plan: SpacePlan, **changes: object) -> SpacePlan:
    """Another report of the drives."""
    return replace(plan, joints=replace(plan.joints, **changes))  # type: ignore[arg-type]


def room(plan: SpacePlan, **changes: object) -> SpacePlan:
    """The same in another room."""
    return plan.asking(workspace=replace(plan.problem.workspace, **changes))  # type: ignore[arg-type]


def shell(plan: SpacePlan) -> SpacePlan:
    """The same inside of a closed mesh that it never touches."""
    corners = box_corners(np.full(3, -0.45), np.array([1.55, 0.55, 0.55]))
    return with_body(plan, "shell", MeshBody(corners, BOX_FACES))


def under_roof(plan: SpacePlan) -> FloatArray:
    """A room that ends halfway into the arm where that is highest."""
    assert plan.problem.workspace.bounds is not None
    bounds = plan.problem.workspace.bounds.copy()
    bounds[1, 2] = np.max(places_of(plan)[..., 2]) + 0.5 * plan.problem.arm.radius
    return np.asarray(bounds)


def cut(plan: SpacePlan, share: float) -> SpacePlan:
    """The first part of the motion alone."""
    few = slice(0, int(share * len(plan.trajectory.time)))
    motion = plan.trajectory
    return plan.moving(
        time=motion.time[few],
        positions=motion.positions[few],
        velocities=motion.velocities[few],
        accelerations=motion.accelerations[few],
    )


def turned(plan: SpacePlan, column: int | IntArray, by: float) -> SpacePlan:
    """The motion with some coordinates changed all along."""
    positions = plan.trajectory.positions.copy()
    positions[:, column] += by
    return plan.moving(positions=positions)


def jolted(plan: SpacePlan, column: int, by: float) -> SpacePlan:
    """The motion with one bend of one sample off."""
    positions = plan.trajectory.positions.copy()
    positions[len(positions) // 3, column] += by
    return plan.moving(positions=positions)


def swapped(plan: SpacePlan) -> SpacePlan:
    """The two bends of every joint taken for each other."""
    order = np.append(np.arange(16).reshape(-1, 2)[:, ::-1].ravel(), 16)
    motion = plan.trajectory
    return plan.moving(
        positions=motion.positions[:, order],
        velocities=motion.velocities[:, order],
        accelerations=motion.accelerations[:, order],
    )


LIES: dict[str, tuple[Change, str]] = {
    "a ball on the way": (lambda p: with_body(p, "ball", SphereBody(middle_link(p), 1e-4)), "wall clearance"),
    "a box on the way": (
        lambda p: with_body(p, "box", BoxBody(middle_link(p) - 0.01, middle_link(p) + 0.01)),
        "wall clearance",
    ),
    "a sheet on the way": (
        lambda p: with_body(p, "sheet", MeshBody(middle_link(p) + np.eye(3) * 0.05 - 0.05 / 3, np.array([[0, 1, 2]]))),
        "wall clearance",
    ),
    "a clearance that is not kept": (lambda p: room(p, clearance=0.4), "wall clearance"),
    "a thicker arm": (lambda p: arm(p, radius=0.45), "wall clearance"),
    "an arm that bites its tail": (lambda p: turned(p, np.arange(0, 16, 2), 1.0), "self-collision"),
    "a lower roof": (lambda p: room(p, bounds=under_roof(p)), "wall clearance"),
    "a room beside the arm": (lambda p: room(p, bounds=np.array([[-3.0, -1, -1], [-2.0, 1, 1]])), "free side"),
    "inside of a mesh": (shell, "free side"),
    "stiffer joints": (lambda p: arm(p, joint_limit=0.2), "joint limit"),
    "a stiffer base": (lambda p: arm(p, base_limit=0.1), "joint limit"),
    "slower joints": (lambda p: limits(p, velocity=p.problem.limits.velocity * 0.05), "joint velocity"),
    "lazier joints": (lambda p: limits(p, acceleration=p.problem.limits.acceleration * 0.05), "joint acceleration"),
    "jerk": (lambda p: limits(p, jerk=np.full(24, 1.0)), "joint jerk"),
    "weaker drives": (lambda p: limits(p, torque=p.problem.limits.torque * 0.1), "joint torque"),
    "less than the share left": (
        lambda p: p.asking(planner=replace(p.problem.planner, effort_share=0.8)),
        "share of velocity",
    ),
    "a slower tip": (lambda p: limits(p, points=(PointLimit(None, 0.1),)), "tip velocity"),
    "a lazier tip": (lambda p: limits(p, points=(PointLimit(None, np.inf, 0.5),)), "tip acceleration"),
    "a slower point": (lambda p: limits(p, points=(PointLimit(0.35, 0.09),)), "point at 0.35 m velocity"),
    "a slower feed": (lambda p: limits(p, feed_velocity=0.05), "feed velocity"),
    "a lazier feed": (lambda p: limits(p, feed_acceleration=0.2), "feed acceleration"),
    "a weaker feed": (lambda p: limits(p, feed_force=0.3), "feed force"),
    "a shorter feed": (lambda p: arm(p, feed=Feed(0.0, 0.3, 0.0)), "feed range"),
    "a longer guide tube": (lambda p: arm(p, feed=Feed(0.0, 0.5, 0.35)), "joints inside the guide"),
    "a goal elsewhere": (lambda p: goal(p, position=beside(p)), "goal position"),
    "another direction": (lambda p: goal(p, direction=p.problem.goal.direction @ _small_turn()), "goal direction"),
    "a place that is not passed": (lambda p: goal(p, via=(np.array([0.0, 0.9, 0.0]),)), "goal via 1"),
    "places in another order": (lambda p: goal(p, via=tuple(places_of(p)[[-1, 0], -1])), "goal via 2"),
    "a pose at the goal": (
        lambda p: p.asking(goal=JointPose(p.trajectory.bend_angles[-1].reshape(8, 2) + 0.02, 0.4)),
        "goal joints",
    ),
    "a base elsewhere at the goal": (
        lambda p: p.asking(goal=JointPose(p.trajectory.bend_angles[-1].reshape(8, 2), 0.3)),
        "goal feed",
    ),
    "another start": (lambda p: turned(p, 6, 1e-5), "start joints"),
    "another base at the start": (lambda p: turned(p, 16, 2e-3), "start feed"),
    "only a part of it": (lambda p: cut(p, 0.8), "rest"),
    "bends taken for each other": (swapped, "start joints"),
    "one bad sample": (lambda p: jolted(p, 5, 1e-3), "velocities against angles"),
    "one bad sample of the feed": (lambda p: jolted(p, 16, 1e-4), "feed velocity against positions"),
    "faster than told": (
        lambda p: reported(p, velocities=0.5 * p.trajectory.velocities),
        "velocities against angles",
    ),
    "more accelerated than told": (
        lambda p: reported(p, accelerations=0.5 * p.trajectory.accelerations),
        "accelerations against velocities",
    ),
    "turned roll": (
        lambda p: driven(p, angles=p.joints.angles + 1e-6 * (np.arange(24) == 5)),
        "revolutes against bends",
    ),
    "drives that turn otherwise": (lambda p: driven(p, velocities=-p.joints.velocities), "revolutes against bends"),
    "wrong torques": (lambda p: driven(p, torques=p.joints.torques * (1.0 + 1e-5)), "torques against dynamics"),
    "wrong forces": (lambda p: driven(p, base_forces=p.joints.base_forces + 1e-5), "feed force against dynamics"),
    "another load": (lambda p: arm(p, payload=0.06), "torques against dynamics"),
    "other inertia": (lambda p: arm(p, inertia_axial=np.full(8, 1.0)), "torques against dynamics"),
    "other gravity": (
        lambda p: p.asking(simulation=replace(p.problem.simulation, gravity=np.array([0.0, 0.1, -9.81]))),
        "torques against dynamics",
    ),
    "other names": (lambda p: driven(p, names=p.joints.names[::-1]), "joint names"),
    "not a number": (lambda p: reported(p, positions=p.trajectory.positions * np.nan), "samples"),
    "too few samples": (lambda p: _every(p, 2), "samples"),
    "a stop left out": (lambda p: p.asking(stops=(Stop(p.problem.goal, p.problem.tolerances),)), "samples"),
}


def _small_turn() -> FloatArray:
    """A turn by twice the tolerance of the direction, about an axis that the last link does not lie along."""
    return np.array([[np.cos(0.03), -np.sin(0.03), 0.0], [np.sin(0.03), np.cos(0.03), 0.0], [0.0, 0.0, 1.0]])


def _every(plan: SpacePlan, step: int) -> SpacePlan:
    motion = plan.trajectory
    return plan.moving(
        time=motion.time[::step],
        positions=motion.positions[::step],
        velocities=motion.velocities[::step],
        accelerations=motion.accelerations[::step],
    )


@pytest.mark.planning
@pytest.mark.parametrize("lie", LIES)
def test_an_untrue_plan_is_refused(lie: str) -> None:
    """What is changed is seen by the check that is meant to see it."""
    change, check = LIES[lie]
    assert check in change(true_plan()).failed()


STILL_TRUE: dict[str, Change] = {
    "a larger room": lambda p: room(p, bounds=2.0 * p.problem.workspace.bounds),
    "no room": lambda p: room(p, bounds=None),
    "nothing at all": lambda p: room(p, bounds=None, obstacles=()),
    "an open mesh about it": lambda p: with_body(p, "sheet", MeshBody(np.eye(3) * 3.0, np.array([[0, 1, 2]]))),
    "rounding": lambda p: turned(p, 6, 1e-13),
    "twice the limits": lambda p: limits(p, velocity=2.0 * p.problem.limits.velocity, torque=None, points=()),
    "an arm that may touch itself": lambda p: arm(p, self_collision=False),
    "a mount in a wall": lambda p: with_body(
        arm(p, mount_length=0.2), "wall", BoxBody(np.array([-0.2, -0.1, -0.1]), np.array([0.02, 0.1, 0.1]))
    ),
    "the pose at the goal": lambda p: p.asking(goal=JointPose(p.trajectory.bend_angles[-1].reshape(8, 2), 0.4)),
}


@pytest.mark.parametrize("change", STILL_TRUE)
def test_a_plan_that_is_still_true_passes(change: str) -> None:
    """What changes nothing of the truth is accepted."""
    assert STILL_TRUE[change](true_plan()).failed() == []


def test_what_is_refused_says_where() -> None:
    """The check names the link, the obstacle and the time, and its place can be found in the motion."""
    plan = with_body(true_plan(), "needle", SphereBody(middle_link(true_plan()), 1e-4))
    (check,) = (check for check in plan.checks() if check.name == "wall clearance")
    assert check.place is not None
    assert check.place.obstacle == "needle"
    assert "'needle'" in check.where
    sample = int(np.argmin(np.abs(plan.trajectory.time - check.place.time)))
    ends = places_of(plan)[sample, check.place.link - 1 : check.place.link + 1]
    assert np.min(np.linalg.norm(ends - middle_link(plan), axis=1)) < plan.problem.arm.link_length


def test_settings_are_the_plane_s() -> None:
    """Tolerances given to the verifier count in space too."""
    plan = goal(true_plan(), position=beside(true_plan()))
    assert "goal position" in plan.failed()
    assert DEFAULT_VERIFICATION.for_problem(plan.problem).contact_tolerance == plan.problem.contact_tolerance
