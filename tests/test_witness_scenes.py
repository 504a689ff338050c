"""Scenes drawn around a witness: what is written is read back, and the witness solves it with room to spare."""

import json
from pathlib import Path

import numpy as np
import pytest

from ccm_opt.core.deadline import Deadline
from ccm_opt.io.reading import load_problem
from ccm_opt.planning.ends import refuse_ends
from ccm_opt.planning.settings import SpaceMotionSettings
from ccm_opt.planning.space_task import space_task
from ccm_opt.scene.distances.surface_tree import SurfaceTree

pytest.importorskip("coal", reason="coal comes with the tests where there is a wheel of it")

from .benchmarks.space_sweep import sweep_rows
from .witness_scenes import FAMILIES, LEAST_GAP, witness_scene, write_scene


@pytest.mark.drawn(2)
@pytest.mark.parametrize("family", FAMILIES)
def test_the_witness_solves_the_problem_that_is_written(tmp_path: Path, family: str) -> None:
    """From start to goal it is free by an independent sweep, stands at every goal, and no end is refused."""
    file = write_scene(witness_scene(family, seed=1, links=24), tmp_path)
    problem = load_problem(file)
    record = json.loads(file.with_suffix(".json").read_text(encoding="utf-8"))
    rows = np.array(record["rows"])
    seen = sweep_rows(problem, rows)
    assert not seen.violations
    assert seen.wall_gap >= LEAST_GAP
    assert seen.wall_gap == pytest.approx(1e-3 * record["gap_mm"], abs=1e-6)
    assert len(record["stops"]) == len(problem.stops) + 1
    tips = problem.arm.joint_positions_at(rows[record["stops"]])[:, -1]
    for tip, goal in zip(tips, (*(stop.goal for stop in problem.stops), problem.goal), strict=True):
        assert np.linalg.norm(tip - goal.tip(problem.arm)) < problem.tolerances.position
    refuse_ends(
        problem,
        space_task(
            problem,
            SurfaceTree.from_triangles(problem.workspace.triangle_soup),
            Deadline.after(60.0),
            SpaceMotionSettings(),
        ),
    )


@pytest.mark.parametrize("start", ["inside", "out"])
def test_the_tip_starts_in_the_guide_tube_or_fed_out(start: str) -> None:
    """Inside, the straight arm's tip is before the hole; out, one link has passed it."""
    arm, pose = (each := witness_scene("baffles", 0, 12, start)).problem.arm, each.problem.start
    assert arm.feed is not None
    shown = pose.feed + arm.length - arm.feed.hole
    assert (shown < 0.0) if start == "inside" else shown == pytest.approx(arm.link_length)
