"""The package's own planner and timing, wrapped by those of a user."""

from dataclasses import dataclass, field, replace

import numpy as np
import pytest

import ccm_opt

from .conftest import PROBLEMS


@dataclass
class Counting:
    """A planner and a retimer that count what they are asked, and let the built-in ones answer."""

    planner: ccm_opt.Planner = field(default_factory=ccm_opt.BuiltInPlanner)
    retimer: ccm_opt.Retimer = field(default_factory=ccm_opt.BuiltInRetimer)
    asked: list[str] = field(default_factory=list)

    def plan(self, problem: ccm_opt.Problem) -> ccm_opt.JointPath:
        """Note it, and plan."""
        self.asked.append("plan")
        return self.planner.plan(problem)

    def retime(self, problem: ccm_opt.Problem, path: ccm_opt.JointPath) -> ccm_opt.problem.solution.JointTrajectory:
        """Note it, and time."""
        self.asked.append("retime")
        return self.retimer.retime(problem, path)


@pytest.mark.drawn(1)
@pytest.mark.parametrize("name", ["open-space", "feed-penetration"])
def test_what_is_wrapped_gives_what_solve_gives(name: str) -> None:
    """Wrapped planner and retimer are asked once each, and the motion is the one without them."""
    problem = ccm_opt.load_problem(PROBLEMS / f"{name}.toml")
    wrapped = Counting()
    ours = ccm_opt.solve(problem, planner=wrapped, retimer=wrapped)
    plain = ccm_opt.solve(problem)
    assert wrapped.asked == ["plan", "retime"]
    assert ours.trajectory.duration == pytest.approx(plain.trajectory.duration, rel=1e-6)


@pytest.mark.parametrize("retiming", ["toppra", "paul"])
def test_the_built_in_retimer_keeps_the_method_of_the_problem(retiming: str) -> None:
    """It times by the problem's own method, and the verifier accepts the result."""
    problem = ccm_opt.load_problem(PROBLEMS / "open-space.toml", changes=[f"planner.retiming={retiming}"])
    path = ccm_opt.BuiltInPlanner().plan(problem)
    trajectory = ccm_opt.BuiltInRetimer().retime(problem, path)
    reference = ccm_opt.solve(problem, planner=Counting(), retimer=ccm_opt.BuiltInRetimer())
    np.testing.assert_allclose(trajectory.positions[-1], reference.trajectory.positions[-1], atol=1e-3)
    assert trajectory.duration == pytest.approx(reference.trajectory.duration, rel=1e-6)


@pytest.mark.drawn(20, of="dear tests")
def test_the_built_in_planner_keeps_constraints() -> None:
    """Constraints that it is given hold on the path, and ``solve`` holds the motion against them."""
    problem = ccm_opt.load_problem(PROBLEMS / "swan-neck.toml")
    high = ccm_opt.Constraint("high", lambda q: q.tip[1], lower=-0.15)
    solution = ccm_opt.solve(problem, planner=ccm_opt.BuiltInPlanner([high]), constraints=[high])
    tips = problem.arm.joint_positions_at(solution.trajectory.positions)[:, -1]
    assert tips[:, 1].min() > -0.15 - 1e-4


def test_a_planner_may_ask_for_a_changed_problem() -> None:
    """A path for more clearance is one for less."""

    class Roomy:
        """Plans with twice the gap."""

        def plan(self, problem: ccm_opt.Problem) -> ccm_opt.JointPath:
            """A path with twice the clearance and two millimetres."""
            clearance = 2.0 * problem.workspace.clearance + 0.002
            return ccm_opt.BuiltInPlanner().plan(
                replace(problem, workspace=replace(problem.workspace, clearance=clearance))
            )

    problem = ccm_opt.load_problem(PROBLEMS / "swan-neck.toml")
    solution = ccm_opt.solve(problem, planner=Roomy())
    assert solution.room is not None
    assert solution.room.nearest.gap >= 0.002 - 1e-6


def test_one_class_stands_for_every_error() -> None:
    """What the package raises on purpose is caught as one; what Python's own users expect is still that."""
    with pytest.raises(ccm_opt.CcmError):
        ccm_opt.load_problem("nowhere.toml")
    assert issubclass(ccm_opt.NoPlanFound, ccm_opt.CcmError)
    assert ccm_opt.core.errors.CcmError is ccm_opt.CcmError


def test_every_name_of_the_public_pictures_is_there() -> None:
    """What ``ccm_opt.plotting`` promises loads, and an unknown name is told with those that there are."""
    from ccm_opt import plotting

    for name in plotting.__all__:
        assert getattr(plotting, name).__name__ == name
    with pytest.raises(AttributeError, match=r"it has .*plan_figure"):
        plotting.plan_picture_of  # noqa: B018 - reading it is the test
