"""Among many walls the tip is led along its shortest path before anything else is tried."""

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from ccm_opt.motion.motion_task import MotionTask
from ccm_opt.motion.settings.search_settings import SearchSettings
from ccm_opt.motion.shortest_path import ShortestPathStrategy
from tests.scenes import clutter, motion_task, sweep_gaps, swept

if TYPE_CHECKING:
    from ccm_opt.motion.failures import Failure

LINKS = 24.0
"""Nominal links to the arm's length."""


def crowded(task: MotionTask, margins: tuple[float, ...] = (0.06, 0.012, 0.12)) -> MotionTask:
    """The task as if thirty walls were many."""
    search = SearchSettings(many_walls=20, crowded_margins=margins)
    return replace(task, settings=replace(task.settings, search=search))


@pytest.mark.parametrize("seed", range(3, 7))
def test_what_is_found_is_certified_and_touches_nothing(seed: int) -> None:
    """A motion begins at the start, ends on the goal and is free in a dense sweep; or every margin has failed."""
    task = crowded(motion_task(clutter(seed, 30).problem()))
    failures: list[Failure] = []
    motion = ShortestPathStrategy().find(task, failures, LINKS)
    if motion is None:
        assert len(failures) == 3
        return
    assert motion.headings[0] == pytest.approx(task.start)
    assert np.allclose(task.arm.joint_positions(motion.headings[-1])[-1], task.goal.position, atol=1e-8)
    frames = [swept(a, b, 6) for a, b in zip(motion.headings[:-1], motion.headings[1:], strict=True)]
    assert min(sweep_gaps(task.arm, task.workspace, np.vstack(frames))) > 0.0


def test_it_is_tried_among_many_walls_alone_and_for_the_tip_alone() -> None:
    """Few walls leave poses at the goal cheap, and a goal for the whole arm is seldom met by a tip that is led."""
    task = motion_task(clutter(3, 30).problem())
    assert not ShortestPathStrategy().applies(task)
    assert ShortestPathStrategy().applies(crowded(task))
    assert not ShortestPathStrategy().applies(replace(crowded(task), goal_headings=task.start))
    assert not ShortestPathStrategy().applies(replace(crowded(task), tip_paths=()))
