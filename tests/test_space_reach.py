"""The map of where the tip can be in space: every cell that is reached has a sound pose, and proofs are true."""

import json
from dataclasses import replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from hypothesis import assume, given, reject, settings
from hypothesis import strategies as st
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

import ccm_opt
from ccm_opt.core.errors import NoPlanFound, ProblemError
from ccm_opt.diagnosis.reach import spread_directions
from ccm_opt.driver.pose_finding import PoseFinder
from ccm_opt.driver.reach_mapping import unreachable_cells
from ccm_opt.io.reading import problem_from_mapping
from ccm_opt.planning.stand_in import stand_in
from ccm_opt.planning.tip_reach import REACH, ReachQuestion, TipFlood, look_at_cell
from ccm_opt.problem import TipGoal
from ccm_opt.problem.solution import ReachMap
from ccm_opt.scene.tool_links import points_with_tool
from ccm_opt.viz.arm_drawing import SIDES
from ccm_opt.viz.views import SceneViews

from .benchmarks.bench_random_arms import LAYOUTS, Drawn
from .command_runs import CommandLine, brightness
from .conftest import PROBLEMS
from .surface_scenes import slow_gaps

SCENE = """
schema = 1
space = 3
name = "behind"

[workspace]
bounds = [[-0.2, -0.35, -0.35], [0.35, 0.35, 0.35]]

[[workspace.obstacles]]
name = "block"
box = [[0.1, -0.1, -0.1], [0.2, 0.1, 0.1]]

[arm]
links = 8
link_length = 0.04
radius = 0.01
base = { position = [-0.1, 0.0, 0.0], direction = [0, 0, 1], up = [-1, 0, 0] }
joint_limit_deg = 60

[limits]
velocity = 1.0
acceleration = 4.0

[start]
shape = "straight"

[goal]
position = [0.05, 0.1, 0.1]
"""


@pytest.fixture
def run(capsys: pytest.CaptureFixture[str]) -> CommandLine:
    """The command line."""
    return CommandLine(capsys)


@cache
def mapped() -> ReachMap:
    """A small map."""
    from ccm_opt.io.reading import parse_problem

    problem = parse_problem(SCENE)
    found = ccm_opt.reach_map(problem, step=0.16, headings=2)  # type: ignore[call-overload]
    assert found.problem.dimension == 3
    return found


@pytest.mark.drawn(20, of="dear tests")
def test_what_is_reached_keeps_off_what_is_proved() -> None:
    """No cell is both; cells in the block, behind the walls of the room and too far away are proved."""
    found = mapped()
    assert not np.any(found.reachable & found.proved)
    places = found.places
    in_block = np.all((places > [0.1, -0.1, -0.1]) & (places < [0.2, 0.1, 0.1]), axis=-1)
    assert in_block.any()
    assert np.all(found.proved[in_block])
    far = np.linalg.norm(places - found.problem.arm.base, axis=-1) > found.problem.arm.length
    assert np.all(found.proved[far])
    assert np.all(found.gap[found.reachable] > 0.0)
    assert np.all(np.isnan(found.gap[~found.reachable]))


@pytest.mark.drawn(20, of="dear tests")
def test_every_pose_of_a_cell_is_sound() -> None:
    """The tip is in the middle of its cell, joints keep their limits, and nothing is touched, by a slow measure."""
    problem = replace(mapped().problem, goal=TipGoal(np.array([0.05, 0.1, 0.1])))
    axes = (np.array([0.0, 0.09]), np.array([-0.05, 0.05]), np.array([-0.1, 0.0, 0.1]))
    settings = replace(REACH, drawn=40)
    question = ReachQuestion.about(problem, 0.1, np.zeros((0, 3)), settings)
    looker = question.looker
    flood = TipFlood(axes, 0.1, np.zeros((2, 2, 3), dtype=bool), 0, settings)
    flood.begin(looker, np.zeros((0, len(looker.start))))
    for asked in flood:
        flood.add(asked, look_at_cell(question, asked))
    assert flood.poses
    arm = problem.arm
    for (i, j, k), unknowns in flood.poses.items():
        pose = looker.stepper.pose(unknowns)
        points = arm.joint_positions_at(pose.q)
        assert points[-1] == pytest.approx([axes[0][i], axes[1][j], axes[2][k]], abs=1e-6)
        assert np.all(np.abs(pose.q) <= arm.bend_limits + 1e-9)
        segments = np.stack((points[:-1], points[1:]), axis=1)[1:]
        assert slow_gaps(segments, problem.workspace.triangle_soup, 0.5).min() >= arm.radius


def test_most_of_what_is_near_is_reached() -> None:
    """An arm in a wide room reaches most of the places within its length, behind the block too."""
    found = mapped()
    near = np.linalg.norm(found.places - found.problem.arm.base, axis=-1) < 0.8 * found.problem.arm.length
    assert found.reachable[near & ~found.proved].mean() > 0.6
    assert found.size == pytest.approx(found.reachable.sum() * 0.16**3)
    assert found.taken[~found.reachable].sum() == 0
    assert 0.05 < found.taken[found.reachable].mean() <= 1.0


def test_directions_are_spread_evenly() -> None:
    """Unit vectors whose mean is nearly nothing, and no two of them near each other."""
    directions = spread_directions(40, 3)
    assert np.linalg.norm(directions, axis=1) == pytest.approx(1.0)
    assert np.linalg.norm(directions.mean(axis=0)) < 0.03
    cosines = directions @ directions.T - 2.0 * np.eye(40)
    assert cosines.max() < np.cos(0.3)


@pytest.mark.drawn(20, of="dear tests")
def test_the_command_writes_record_arrays_and_picture(tmp_path: Path, run: CommandLine) -> None:
    """An arm that is fed into blades is mapped from the motion to its goal; the folder has all of it."""
    done = run("reach", PROBLEMS / "space" / "blade-row.toml", "--out", tmp_path, "--step", "0.35")
    assert done.code == 0
    assert "volume [m³]" in done.out
    folder = tmp_path / "blade-row"
    record = json.loads((folder / "reach.json").read_text())
    with np.load(folder / "reach.npz") as arrays:
        assert arrays["reachable"].sum() == record["reached"] > 0
        assert arrays["reachable"].shape == (len(arrays["x"]), len(arrays["y"]), len(arrays["z"]))
        assert arrays["taken"].shape == (*arrays["reachable"].shape, 0)
    assert len(record["meshes"]) == len(list((folder / "meshes").iterdir()))
    assert brightness(folder / "reach.png") > 0.1


@pytest.mark.drawn(20, of="dear tests")
def test_maps_are_the_same_whatever_the_workers(tmp_path: Path, run: CommandLine) -> None:
    """One process and two of them write the same bytes, with directions too; so do results that come out of order."""
    file = tmp_path / "behind.toml"
    file.write_text(SCENE)
    written = []
    for workers in ("1", "2"):
        out = tmp_path / workers
        done = run(
            "reach", file, "--out", out, "--step", "0.45", "--headings", "1", "--workers", workers, "--no-pictures"
        )
        assert done.code == 0
        written.append(next(out.glob("*/reach.npz")).read_bytes())
    assert written[0] == written[1]


@pytest.mark.parametrize(("at", "length"), [(0.15, 0.0), (0.03, 0.6), (-0.15, 0.0)])
def test_slices_show_the_bodies_that_they_cut(at: float, length: float) -> None:
    """A box leaves the outline of its section, and nothing in planes that pass it."""
    axes = Figure().add_subplot()
    SceneViews(mapped().problem).draw_cut(axes, SIDES[0], 2, at)
    drawn = [line for each in axes.collections if isinstance(each, LineCollection) for line in each.get_segments()]
    assert sum(float(np.linalg.norm(np.subtract(line[1], line[0]))) for line in drawn) == pytest.approx(length)


@pytest.mark.drawn(20, of="dear tests")
def test_results_may_come_in_any_order() -> None:
    """A wave whose tasks are done in another order leads to the same map, pose by pose."""
    settings = replace(REACH, drawn=10)
    question = ReachQuestion.about(mapped().problem, 0.2, spread_directions(2, 3), settings)
    axes = tuple(first + np.array([0.0, 0.2]) for first in (-0.2, -0.1, 0.05))
    found = []
    for backwards in (False, True):
        flood = TipFlood(axes, 0.2, np.zeros((2, 2, 2), dtype=bool), 2, settings)
        flood.begin(question.looker, np.zeros((0, len(question.looker.start))))
        while wave := list(flood):
            for asked in reversed(wave) if backwards else wave:
                flood.add(asked, look_at_cell(question, asked))
        found.append(flood)
    assert len(found[0].poses) > 3
    assert list(found[0].poses) == list(found[1].poses)
    assert all(np.array_equal(found[0].poses[cell], found[1].poses[cell]) for cell in found[0].poses)
    assert np.array_equal(found[0].taken, found[1].taken)
    assert np.array_equal(found[0].gap, found[1].gap, equal_nan=True)


def test_grids_that_make_no_sense_are_refused(tmp_path: Path, run: CommandLine) -> None:
    """Too many cells and cells of no width, in one sentence each."""
    file = tmp_path / "behind.toml"
    file.write_text(SCENE)
    for arguments, words in (
        (("--step", "0.0005"), "cells; at most"),
        (("--step", "-1"), "--step must be above 0"),
    ):
        done = run("reach", file, "--out", tmp_path / "out", *arguments)
        assert done.code == 2
        assert words in done.err
    assert not (tmp_path / "out").exists()


@pytest.mark.drawn(2)
@pytest.mark.parametrize("kinds", LAYOUTS)
@given(seed=st.integers(0, 1 << 31))
@settings(max_examples=2)
def test_no_tip_of_any_layout_is_where_the_map_proves_that_it_cannot_be(kinds: str, seed: int) -> None:
    """Tips of random free poses, as links and tool put them, are in no place that is proved to be out of reach."""
    with TemporaryDirectory() as folder:
        try:
            data = Drawn(seed, 8.0, frozenset(kinds.split()), Path(folder)).data
            problem = problem_from_mapping(data, folder=Path(folder))
            finder = PoseFinder.of(problem)
            found = ccm_opt.reach_map(problem, step=problem.arm.length, headings=1)
        except (ValueError, NoPlanFound):
            reject()  # no goal was found for the arm that was drawn, or its start is beyond a limit
        except ProblemError as error:
            assume("start is in contact" not in str(error))
            raise
    arm = problem.arm
    poses = np.array([finder.configuration(pose) for pose in finder.drawn(40)])
    assume(len(poses) > 0)
    tips = points_with_tool(arm, poses)[:, -1]
    whole = stand_in(problem)
    box = whole.workspace.box
    assert box is not None
    places = tips if box.shape[1] == arm.dimension else np.insert(tips, 1, 0.0, axis=1)
    for place in places[np.all((places > box[0]) & (places < box[1]), axis=1)]:
        assert not unreachable_cells(whole, [np.array([x]) for x in place]).any()
    axes = found.axes[::-1] if arm.dimension == 2 else found.axes
    assert found.reachable.shape == tuple(map(len, axes))
    assert not np.any(found.reachable & found.proved)
