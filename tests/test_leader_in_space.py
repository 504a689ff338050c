"""How far fed arms in space leave the path of their tip, against a search of all samples, and the way back."""

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from ccm_opt.cli.commands import app
from ccm_opt.driver.metrics import leader_deviation
from ccm_opt.planning.curve_map import CurveMap
from ccm_opt.planning.limits.following import leaders_path
from ccm_opt.robot.base_axes import Feed
from tests.snakes_in_space import snake

THERE_AND_BACK = """
schema = 1
space = 3
name = "there-and-back"
[workspace]
[[workspace.obstacles]]
name = "ball"
sphere = { center = [0.3, 0.12, 0.02], radius = 0.06 }
[arm]
links = 12
link_length = 0.05
radius = 0.012
base = { position = [-0.6, 0.0, 0.0], direction = [1.0, 0.0, 0.0], up = [0.0, 0.0, 1.0] }
joint_limit_deg = 45.0
feed = { range = [0.0, 0.6] }
[limits]
velocity = 1.0
acceleration = 5.0
feed_velocity = 0.2
feed_acceleration = 1.0
[start]
shape = "straight"
[[goal]]
position = [0.35, -0.2, 0.1]
pause = 0.5
[[goal]]
shape = "straight"
[simulation]
step = 0.005
"""
ARM = snake(16, length=0.8, feed=Feed(-0.8, 0.0, 0.0))


def fed_along(curvatures: np.ndarray, changing: float) -> np.ndarray:
    """Configurations of an arm that is fed along a curve, which changes by a share on the way."""
    curve, start = CurveMap.through(ARM, np.append(np.zeros(32), -0.8))
    start[: curve.feed_column] = curvatures
    motion = np.repeat(start[None], 40, axis=0)
    motion[:, curve.feed_column] = np.linspace(-0.8, 0.0, 40) / curve.scale[curve.feed_column]
    motion[:, : curve.feed_column] *= 1.0 + changing * np.linspace(-1.0, 0.0, 40)[:, None]
    return np.stack([curve.configuration(v) for v in motion])


def test_an_arm_that_is_fed_along_a_curve_that_lies_still_follows_its_tip() -> None:
    """By a small part of a link; one whose curve changes meanwhile does not."""
    curvatures = np.full(2 * 11, 0.1)
    still = leader_deviation(ARM, fed_along(curvatures, 0.0))
    changing = leader_deviation(ARM, fed_along(curvatures, 1.0))
    assert still is not None
    assert changing is not None
    assert still.worst < 0.5 * ARM.link_length
    assert still.mean < 0.1 * ARM.link_length
    assert changing.mean > 3.0 * still.mean


@pytest.mark.parametrize("seed", range(4))
def test_the_deviation_is_that_of_all_samples(seed: int) -> None:
    """Against distances of every place from every leg of the path."""
    rng = np.random.default_rng(seed)
    positions = fed_along(0.2 * rng.normal(size=22), rng.uniform(0.0, 1.0))
    found = leader_deviation(ARM, positions)
    assert found is not None

    poses = positions
    joints = ARM.joint_positions_at(poses)
    path = leaders_path(ARM, poses, joints)
    assert path[0] == pytest.approx(ARM.base + ARM.hole * ARM.direction)
    distances = []
    for pose, feed in zip(joints, poses[:, -1], strict=True):
        for link in range(ARM.links):
            for share in (np.arange(8) + 0.5) / 8:
                if feed + ARM.link_length * (link + share) <= ARM.hole:
                    continue
                point = pose[link] + share * (pose[link + 1] - pose[link])
                legs = np.diff(path, axis=0)
                along = np.einsum("md,md->m", point - path[:-1], legs) / np.einsum("md,md->m", legs, legs)
                nearest = path[:-1] + np.clip(along, 0.0, 1.0)[:, None] * legs
                distances.append(np.linalg.norm(point - nearest, axis=1).min())
    assert found.mean == pytest.approx(np.mean(distances), abs=1e-9)
    assert found.worst == pytest.approx(np.max(distances), abs=1e-9)


def test_arms_that_are_not_fed_and_motions_in_the_tube_have_no_leader() -> None:
    """There is no figure then."""
    assert leader_deviation(snake(8), np.zeros((5, 16))) is None
    inside = np.column_stack((np.zeros((5, 32)), np.linspace(-0.8, -0.801, 5)))
    assert leader_deviation(ARM, inside) is None


@pytest.mark.drawn(1, of="there and back")
def test_an_arm_goes_back_the_way_that_it_came(tmp_path: Path) -> None:
    """Told to end as it began, it retraces its motion; timed and verified, and the folder can be checked."""
    problem = tmp_path / "problem.toml"
    problem.write_text(THERE_AND_BACK)
    runner = CliRunner()
    solved = runner.invoke(app, ["solve", str(problem), "--out", str(tmp_path), "--no-pictures"])
    assert solved.exit_code == 0, solved.output
    folder = tmp_path / "there-and-back"
    checked = runner.invoke(app, ["check", str(folder)])
    assert checked.exit_code == 0, checked.output
    record = json.loads((folder / "solution.json").read_text())
    assert 0.0 < record["metrics"]["leader_deviation_mean_m"] < record["metrics"]["leader_deviation_worst_m"]

    # What the bends are where, on the way out and on the way back.
    with np.load(folder / "solution.npz") as arrays:
        feed = arrays["base_feed"]
        bends = arrays["bend_angles"]
    turning = int(np.argmax(feed))
    assert feed[-1] == pytest.approx(feed[0], abs=1e-9)
    assert bends[-1] == pytest.approx(bends[0], abs=1e-9)
    for k in range(turning, len(feed), 50):
        assert np.abs(bends[:turning] - bends[k]).max(axis=(1, 2)).min() < 2e-3


@pytest.mark.drawn(1, of="there and back")
def test_an_arm_goes_back_past_several_goals_and_rests_at_the_corners_of_its_way(tmp_path: Path) -> None:
    """Its path has a corner at each of them, through which nothing can be driven; it takes as long as the way there."""
    problem = tmp_path / "problem.toml"
    between = "[[goal]]\nposition = [0.35, -0.1, 0.2]\n[[goal]]\nposition = [0.4, -0.15, -0.05]\n[[goal]]\nshape"
    problem.write_text(THERE_AND_BACK.replace("[[goal]]\nshape", between))
    solved = CliRunner().invoke(app, ["solve", str(problem), "--out", str(tmp_path), "--no-pictures"])
    assert solved.exit_code == 0, solved.output
    with np.load(tmp_path / "there-and-back" / "solution.npz") as arrays:
        time, stops, bends = arrays["time"], arrays["stops"], arrays["bend_angles"]
    assert len(stops) == 3
    assert bends[-1] == pytest.approx(bends[0], abs=1e-9)
    there = time[stops[2]] - 0.5
    assert time[-1] - time[stops[2]] == pytest.approx(there, rel=0.02)
