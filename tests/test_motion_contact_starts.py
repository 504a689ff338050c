"""Motions that begin in contact: with a gap of exactly zero they may leave, deeper ones are refused."""

from dataclasses import replace

import numpy as np
import pytest
import shapely

from ccm_opt.core.errors import UnreachableGoal
from ccm_opt.planning.ends import resolve_ends
from ccm_opt.problem import JointPose, Problem
from ccm_opt.scene.contact_finder import DEFAULT_CERTIFICATE
from ccm_opt.scene.workspace import Obstacle, PlaneShape, Workspace
from tests.planned_runs import run
from tests.scenes import ROOM, Scene, make_arm

RADIUS = 0.015
GOAL = np.linspace(1.2, 2.2, 24)


def beside(wall: shapely.Geometry, rounding: float = 0.0, radius: float = RADIUS) -> Problem:
    """A straight arm along x beside one wall, to be bent away to its left."""
    arm = make_arm(24, radius)
    workspace = Workspace(ROOM, (Obstacle("wall", PlaneShape(wall, rounding)),))
    return Scene(arm, workspace, np.zeros(24), GOAL).problem(time_limit=900.0)


@pytest.mark.parametrize(
    ("wall", "rounding"),
    [
        (shapely.box(-1.2, -1.0, 1.2, -RADIUS), 0.0),
        (shapely.Point(0.5, -RADIUS - 0.05), 0.05),
        (shapely.box(1.0 + RADIUS, -0.1, 1.2, 0.1), 0.0),
    ],
    ids=["along a floor", "at a post", "tip at a wall"],
)
def test_start_in_contact_is_left(wall: shapely.Geometry, rounding: float) -> None:
    """A start that touches with no gap at all is planned, and its timed motion is verified."""
    assert run(beside(wall, rounding)).outcome == "verified"


def test_goal_in_contact_is_reached() -> None:
    """A goal for the whole arm may touch with no gap."""
    problem = beside(shapely.box(-1.2, -1.0, 1.2, -RADIUS))
    turned = replace(problem, start=JointPose(problem.arm.bends(GOAL)), goal=problem.start)
    assert run(turned).outcome == "verified"


def test_deeper_starts_are_refused() -> None:
    """A start that is deeper in a wall than rounding is refused, with the link and the wall."""
    with pytest.raises(UnreachableGoal, match=r"link \d+ is 0\.\d+ mm too near to 'wall'"):
        resolve_ends(beside(shapely.box(-1.2, -1.0, 1.2, -RADIUS + 2.0 * DEFAULT_CERTIFICATE.contact)))


def test_an_axis_may_not_lie_on_a_wall() -> None:
    """An arm of no width that touches a wall is refused: it would be neither on this side nor on that."""
    with pytest.raises(UnreachableGoal, match=r"the start is in contact: link \d+ to 'wall'"):
        resolve_ends(beside(shapely.box(0.4, -1.0, 0.6, 0.0), radius=0.0))
