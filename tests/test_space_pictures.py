"""Pictures of plans in space: a section that sees every surface beside the arm, and goals with their numbers."""

from dataclasses import replace

import numpy as np
from matplotlib.figure import Figure

from ccm_opt.problem import JointPose, Limits, Problem, Stop, TipGoal, Tolerances
from ccm_opt.scene.bodies import Body, BoxBody, CapsuleBody
from ccm_opt.scene.workspace import Obstacle, Workspace
from ccm_opt.viz.arm_drawing import SIDES, PlanDrawing
from ccm_opt.viz.arm_section import ArmSection, section_along
from ccm_opt.viz.plan import draw_goals

from .space_arms import space_arm
from .space_folders import solved


def section_beside(body: Body, base: tuple[float, float, float]) -> ArmSection:
    """The section along a straight arm of four links among one body."""
    arm = space_arm(4, base=np.array(base))
    problem = Problem(
        "one body",
        Workspace(bounds=None, obstacles=(Obstacle("body", body),)),
        arm,
        Limits(np.ones(12), np.full(12, 4.0)),
        JointPose(np.zeros((4, 2))),
        TipGoal(np.array([0.3, 0.0, 0.0])),
    )
    return section_along(problem, arm.joint_positions_at(np.zeros(len(arm.coordinates))), 9, 1.0)


def test_a_section_measures_the_room_across_the_arm() -> None:
    """In a box the rays across a straight arm are as long as its sides are away, and the nearest side counts."""
    box = BoxBody(np.array([-1.0, -0.1, -0.2]), np.array([2.0, 0.3, 0.25]))
    section = section_beside(box, (0.1, 0.02, 0.05))
    assert np.allclose(section.free, [0.2, 0.28, 0.25, 0.12], atol=1e-6)
    assert np.allclose(section.nearest, 0.12, atol=1e-12)


def test_a_section_sees_round_bodies() -> None:
    """A bar above the arm is met by the rays that go up, where it is, and by no others."""
    bar = CapsuleBody(np.array([-1.0, 0.0, 0.2]), np.array([2.0, 0.0, 0.2]), 0.05)
    section = section_beside(bar, (0.0, 0.0, 0.0))
    assert np.allclose(section.free[:, 0], 0.15, atol=1e-3)
    assert np.all(section.free[:, 1:] == 1.0)
    assert np.allclose(section.nearest, 0.15, atol=1e-12)


def test_a_section_sees_what_passes_between_its_rays() -> None:
    """A thin bar beside the arm, slanted so that no ray of the four meets it, is as near as it is."""
    length = space_arm(4).length
    middle = np.array([0.5 * length, 0.08, 0.08])
    aside = 0.05 * np.array([0.0, 1.0, -1.0])
    section = section_beside(CapsuleBody(middle - aside, middle + aside, 0.01), (0.0, 0.0, 0.0))
    assert np.all(section.free == 1.0)
    expected = np.hypot(section.place - 0.5 * length, 0.08 * np.sqrt(2.0)) - 0.01
    assert np.allclose(section.nearest, expected, atol=1e-12)


def test_goals_of_a_tour_are_numbered_in_every_view() -> None:
    """Each goal has its number beside it where there are several, and none where there is one."""
    plan = solved()
    points = plan.joint_positions
    tour = replace(
        plan,
        problem=replace(plan.problem, stops=(Stop(TipGoal(points[3, -1]), Tolerances()),)),
        trajectory=replace(plan.trajectory, stops=(3,)),
    )
    for shown, numbers in ((plan, []), (tour, ["1", "2"])):
        axes = Figure().add_subplot()
        draw_goals(axes, PlanDrawing.from_solution(shown), SIDES[0])
        assert [text.get_text() for text in axes.texts if text.get_text()] == numbers


def test_places_to_pass_are_named_in_the_legend() -> None:
    """The crosses of a goal with places to pass stand in the legend once, and there is none without them."""
    plan = solved()
    points = plan.joint_positions
    for via, named in (((), 0), ((points[1, -1], points[2, -1]), 1)):
        problem = replace(plan.problem, goal=TipGoal(points[-1, -1], via=via))
        axes = Figure().add_subplot()
        draw_goals(axes, PlanDrawing.from_solution(replace(plan, problem=problem)), SIDES[0])
        assert axes.get_legend_handles_labels()[1].count("via point") == named
