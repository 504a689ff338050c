"""Drawing an arm back along itself: when it is tried, that it is safe, and that it leads out of narrow places."""

from dataclasses import replace

import numpy as np
import pytest
import shapely

from ccm_opt.core.arrays import FloatArray
from ccm_opt.planning.continuation import Stalled, follow
from ccm_opt.planning.pose import Pose
from ccm_opt.planning.retraction import Withdrawal, lies_confined, ways_back, withdrawals
from ccm_opt.planning.search_run import passage_entry
from ccm_opt.planning.step import Stepper
from ccm_opt.problem import JointPose, TipGoal
from ccm_opt.scene.certificate import Certificate
from ccm_opt.scene.workspace import Obstacle, PlaneShape, Workspace
from tests.benchmarks.withdrawal_scenes import way_in, way_out
from tests.benchmarks.wound_scenes import unwound
from tests.planned_runs import run
from tests.scenes import ROOM, Scene, later, make_arm, make_stepper, motion_task

LINKS = 24


def duct(width: float) -> Workspace:
    """A straight duct to the right of the base, from 0.25 m on."""
    walls = [
        shapely.box(0.25, 0.5 * width, 1.1, 0.5 * width + 0.1),
        shapely.box(0.25, -0.5 * width - 0.1, 1.1, -0.5 * width),
    ]
    return Workspace(ROOM, tuple(Obstacle(f"duct {k}", PlaneShape(wall)) for k, wall in enumerate(walls)))


def in_duct(width: float, heading: float) -> Scene:
    """An arm that lies straight in the duct and is wanted straight with another heading."""
    return Scene(make_arm(LINKS), duct(width), np.zeros(LINKS), np.full(LINKS, heading))


def guides_back(scene: Scene, length: float = 5.0) -> tuple[Stepper, Pose, list[Withdrawal]]:
    """The guides that draw a scene's arm back, with the stepper and the start that they are for."""
    stepper, start = make_stepper(scene)
    path = motion_task(scene.problem()).tip_paths[0]
    end = stepper.pose(start.v + np.eye(len(start.v))[0] * scene.goal[0])
    ways = ways_back(stepper, start, end, path)
    return stepper, start, [guide for _, guide in withdrawals(stepper, start, end, ways, length)]


def stack_configurations(poses: list[Pose]) -> FloatArray:
    """The configurations of poses, shape (K, c)."""
    return np.array([pose.q for pose in poses])


@pytest.mark.parametrize(("width", "confined"), [(0.05, True), (0.12, True), (0.6, False)])
def test_an_arm_lies_confined_where_no_fold_has_room_beside_it(width: float, confined: bool) -> None:
    """In a duct hardly wider than the arm and in one too narrow for a fold, but not in a hall."""
    scene = in_duct(width, 3.0)
    stepper, start = make_stepper(scene)
    path = motion_task(scene.problem()).tip_paths[0]
    assert lies_confined(stepper, start, path) is confined


@pytest.mark.parametrize("heading", [2.6, -2.6])
def test_a_fold_draws_the_arm_out_of_its_duct_safely(heading: float) -> None:
    """The tip comes out of the duct, what is still inside slides along it, and nothing is touched."""
    scene = in_duct(0.05, heading)
    stepper, start, guides = guides_back(scene)
    guide = guides[0]
    assert 0.0 < guide.free_from < guide.fold.track.length
    try:
        poses = follow(stepper, guide.afresh(), start, later())
    except Stalled as stalled:
        pytest.fail(str(stalled))
    assert poses[-1].points[-1][0] < 0.3
    assert len(Certificate(scene.arm, scene.workspace).failures(stack_configurations(poses))) == 0
    inside = [pose.points[pose.points[:, 0] > 0.3] for pose in poses]
    assert max(np.abs(points[:, 1]).max(initial=0.0) for points in inside) < 0.025


def test_the_base_turns_least_on_the_first_way_back() -> None:
    """Both sides are offered, wound as the arm is wound on them, and the way with the lesser turn comes first."""
    for heading in (2.0, -2.0):
        stepper, start, guides = guides_back(in_duct(0.05, heading))
        turns = [guide.fold.old[0] - stepper.space.arm.headings(start.q)[0] for guide in guides]
        assert [abs(turn) for turn in turns] == sorted(abs(turn) for turn in turns)
        assert turns[0] == pytest.approx(heading)
        assert np.diff(turns) == pytest.approx(-2.0 * np.pi * np.sign(heading))


def test_a_withdrawal_begins_afresh_each_time() -> None:
    """What is followed moves its own fold and not that of the guide it was made from."""
    _, start, guides = guides_back(in_duct(0.05, 2.6))
    guide = guides[0]
    before = guide.fold.fold_at
    first = guide.afresh()
    assert first.progress(start)
    assert first.fold.fold_at > before
    assert guide.fold.fold_at == before
    assert guide.afresh().fold.fold_at == before


@pytest.mark.parametrize("width", [0.05, 0.12])
def test_the_arm_is_drawn_in_as_far_as_the_mouth_of_its_passage(width: float) -> None:
    """The mouth is where the duct begins, a sample of the way and the step before its corners off at most."""
    scene = in_duct(width, 3.0)
    stepper, start = make_stepper(scene)
    mouth = passage_entry(stepper, start, motion_task(scene.problem()).tip_paths[0])
    assert mouth == pytest.approx(0.25, abs=0.05)


def test_no_arm_is_drawn_in_where_it_fills_no_passage() -> None:
    """In a hall there is no mouth."""
    scene = in_duct(0.6, 3.0)
    stepper, start = make_stepper(scene)
    assert passage_entry(stepper, start, motion_task(scene.problem()).tip_paths[0]) is None


@pytest.mark.drawn(1)
@pytest.mark.parametrize("kind", ["tip", "arm"])
def test_an_arm_whose_base_is_in_a_bottle_is_drawn_in_through_its_neck(kind: str) -> None:
    """From outside the arm comes back into the bottle, coils up there, and the verifier passes the motion."""
    out = way_in("in-bottle", 2, 900.0)
    there = run(out)
    assert there.trajectory is not None, there.reason
    back = run(way_out(out, there.trajectory, kind), optimised=False)
    assert back.outcome == "verified", back.reason


@pytest.mark.drawn(1)
@pytest.mark.planning
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_coils_have_a_known_way_out(seed: int) -> None:
    """Straightened joint after joint from the tip on, a coil touches nothing: its problem is known to have a plan."""
    problem = way_in("coil", seed)
    goal = problem.goal
    assert isinstance(goal, JointPose)
    poses = np.array(unwound(problem.arm, problem.arm.headings(goal.bends), 3))
    # Certified between poses where they stand still only by rounding: as near as they are, all of it is free.
    assert len(Certificate(problem.arm, problem.workspace).failures(problem.arm.bends(poses))) == 0


def test_an_arm_leaves_a_duct_by_drawing_back() -> None:
    """The whole planner finds the way out, by this candidate, and the verifier passes it."""
    scene = in_duct(0.05, 2.6)
    goal = TipGoal(scene.goal_tip.position, heading=2.6)
    planned = run(replace(scene.problem(goal), name="out of a duct"))
    assert planned.outcome == "verified", planned.reason
    assert planned.candidate.startswith("drawn back")
