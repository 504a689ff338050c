"""Pictures and films of a plan: fitted to the action, in the unit of the file, from a solution or from a folder."""

from dataclasses import replace
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from matplotlib.figure import Figure
from PIL import Image
from typer.testing import CliRunner

from ccm_opt.cli.commands import app
from ccm_opt.cli.drawing import STILL_FIGURES, draw_figures
from ccm_opt.cli.output import FigureName
from ccm_opt.core.errors import ProblemError
from ccm_opt.driver.clearance_over_time import clearance_over_time
from ccm_opt.io.folder import WRITTEN_FILES, write_solution
from ccm_opt.io.reading import parse_problem
from ccm_opt.io.reading_back import load_motion
from ccm_opt.io.record_reading import recorded_curves, recorded_nearest
from ccm_opt.problem import LookAt, TipGoal
from ccm_opt.problem.solution import Solution
from ccm_opt.viz import films as video
from ccm_opt.viz.arm_drawing import PlanDrawing
from ccm_opt.viz.films import make_film, motion_gif, motion_mp4
from ccm_opt.viz.plan import even_steps, number_goals, plan_figure, plan_picture
from ccm_opt.viz.settings import FILM
from ccm_opt.viz.views import action_window

from .conftest import SMALL_PROBLEM

BEGINNINGS = {"png": b"\x89PNG", "svg": b"<?xml", "pdf": b"%PDF"}


@pytest.fixture
def measured(small_solution: Solution) -> Solution:
    """The made-up plan with the record of its room, which a wanted gap of 0.2 m makes large enough to see the post."""
    room = clearance_over_time(small_solution.problem, small_solution.trajectory, 0.2)
    return replace(small_solution, room=room)


@pytest.fixture
def plan(measured: Solution) -> PlanDrawing:
    """What pictures show of it."""
    return PlanDrawing.from_solution(measured)


@pytest.fixture
def folder(measured: Solution, tmp_path: Path) -> Path:
    """Its output folder."""
    return write_solution(measured, tmp_path / "runs")


@pytest.mark.planning
@pytest.mark.parametrize("kind", ["png", "svg", "pdf"])
def test_the_picture_has_every_format_and_is_always_the_same(plan: PlanDrawing, kind: str) -> None:
    """Files begin as their format does, and drawing again gives the same bytes."""
    first = plan_picture(plan, kind)  # type: ignore[arg-type]
    assert first.startswith(BEGINNINGS[kind])
    assert plan_picture(plan, kind) == first  # type: ignore[arg-type]


def test_the_picture_is_fitted_to_the_action(plan: PlanDrawing) -> None:
    """All of the arm at all times is in it, little else is, and nothing that is far out of the room."""
    xmin, ymin, xmax, ymax = action_window(plan.problem, plan.points).ravel()
    radius = plan.problem.arm.radius
    assert np.all(plan.points - radius >= (xmin, ymin))
    assert np.all(plan.points + radius <= (xmax, ymax))
    room = plan.problem.workspace.boundary
    assert shapely.box(xmin, ymin, xmax, ymax).area < 0.5 * room.area
    assert shapely.box(xmin, ymin, xmax, ymax).within(room.buffer(0.1))


def test_axes_are_in_the_unit_of_the_file() -> None:
    """A file in millimetres has millimetres at its axes, at round numbers; without a file the problem's unit counts."""
    problem = parse_problem(SMALL_PROBLEM.replace('name = "small"', 'name = "small"\nunits = "in"'))
    points = problem.arm.joint_positions(np.zeros((3, 4)))
    trajectory = _still(problem.arm.links)
    figure = plan_figure(PlanDrawing(problem, trajectory, points))
    (axes,) = figure.axes
    assert axes.get_xlabel() == "x [in]"
    ticks = np.array(axes.get_xticks()) / 0.0254
    steps = np.diff(ticks)
    np.testing.assert_allclose(steps, steps[0], rtol=1e-9)
    (in_metres,) = plan_figure(PlanDrawing(replace(problem, length_unit="m"), trajectory, points)).axes
    assert in_metres.get_xlabel() == "x [m]"
    np.testing.assert_allclose(ticks, np.round(ticks, 3), atol=1e-9)


def _still(links: int):  # noqa: ANN202 - a trajectory of three samples
    """Three samples of an arm that does not move."""
    from ccm_opt.problem.solution import JointTrajectory

    rest = np.zeros((3, links))
    return JointTrajectory(np.array([0.0, 0.5, 1.0]), rest, rest, rest)


def test_the_least_gap_is_marked_where_it_is(plan: PlanDrawing) -> None:
    """The mark stands as far from the link as from the post, and its words name gap and time."""
    near = plan.nearest
    assert near is not None
    assert near.obstacle == "post"
    figure = plan_figure(plan)
    label = f"least gap {1e3 * near.gap:.1f} mm at {near.time:.2f} s"
    (place,) = (line.get_xydata()[0] for line in figure.axes[0].lines if line.get_label() == label)
    post = plan.problem.workspace.obstacles[0]
    at = [np.interp(near.time, plan.trajectory.time, column) for column in plan.trajectory.positions.T]
    pose = plan.problem.arm.joint_positions_at(np.array(at))
    to_link = shapely.distance(shapely.LineString(pose[near.link - 1 : near.link + 1]), shapely.Point(place))
    assert to_link == pytest.approx(shapely.distance(post.core, shapely.Point(place)), rel=1e-9)
    assert label in [text.get_text() for text in figure.legends[0].get_texts()]


def test_the_legend_fits_beside_a_narrow_drawing(plan: PlanDrawing) -> None:
    """All of it is within the figure where the motion is much higher than wide, and the gap has a long label."""
    figure = plan_figure(replace(plan, points=plan.points @ np.array([[0.0, 1.0], [0.05, 0.0]])))
    (legend,) = figure.legends
    assert "least gap" in legend.get_texts()[-1].get_text()
    legend.get_texts()[-1].set_text("least gap 1234.5 mm at 123.45 s")
    figure.draw_without_rendering()
    extent = legend.get_window_extent()
    assert extent.x0 >= 0.0
    assert extent.x1 <= figure.bbox.width


@settings(max_examples=20)
@given(
    st.lists(st.tuples(*[st.floats(0.0, 1.0)] * 2), min_size=2, max_size=3),
    st.none() | st.floats(-np.pi, np.pi),
)
def test_numbers_of_goals_stay_within_their_view(places: list[tuple[float, float]], heading: float | None) -> None:
    """No disc leaves a view two inches wide, also of goals at its edge."""
    axes = Figure(figsize=(2.0, 2.0), dpi=72).add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set(xlim=(0.0, 1.0), ylim=(0.0, 1.0))
    number_goals(axes, np.array(places), [heading] * len(places))
    centres = 144.0 * np.array([text.get_position() for text in axes.texts])
    assert np.all(np.minimum(centres, 144.0 - centres) >= 7.0 - 1e-9)


def test_poses_are_equally_far_apart(plan: PlanDrawing) -> None:
    """Between poses that are drawn all joints together travel about equally far."""
    samples = even_steps(plan.points, 5, ends=True)
    assert (samples[0], samples[-1]) == (0, len(plan.points) - 1)
    moved = np.linalg.norm(np.diff(plan.points, axis=0), axis=2).mean(axis=1)
    travelled = np.concatenate(([0.0], np.cumsum(moved)))[samples]
    np.testing.assert_allclose(np.diff(travelled), travelled[-1] / 6.0, atol=2.0 * moved.max())


def test_the_film_lasts_as_long_as_the_motion(plan: PlanDrawing) -> None:
    """Its frames end when the motion does, to a hundredth of a second, and the first and last differ."""
    film = Image.open(BytesIO(motion_gif(plan)))
    shown = 0.0
    pictures = []
    for k in range(film.n_frames):
        film.seek(k)
        pictures.append(np.asarray(film.convert("RGB")))
        shown += film.info["duration"] / 1000.0
    assert film.n_frames == round(FILM.frames_a_second * plan.trajectory.duration) + 1
    assert shown - FILM.last_frame / 1000.0 == pytest.approx(plan.trajectory.duration, abs=0.011)
    assert np.any(pictures[0] != pictures[-1])


def test_long_films_are_faster_than_the_motion(plan: PlanDrawing) -> None:
    """A motion of a minute has no more frames than a film may have, and its samples are evenly spread in time."""
    slow = replace(plan, trajectory=replace(plan.trajectory, time=60.0 * plan.trajectory.time))
    film = make_film(slow)
    assert len(film.shown) == FILM.most_frames
    assert film.seconds == pytest.approx((FILM.most_frames - 1) / FILM.frames_a_second)
    spread = np.diff(slow.trajectory.time[film.shown])
    assert np.ptp(spread) <= 2.0 * np.max(np.diff(slow.trajectory.time)) + 1e-9


def test_a_film_shows_what_the_arm_looks_at(plan: PlanDrawing) -> None:
    """A line of sight leads from the end of the tip's path to the place that has to be seen."""
    tip = plan.points[-1, -1]
    look_at = LookAt(np.add(tip, (0.1, 0.05)), (0.05, 0.2), 0.5)
    problem = replace(plan.problem, goal=TipGoal.looking(look_at), tolerances=look_at.tolerances)
    film = make_film(replace(plan, problem=problem))
    assert any(np.array_equal(line.get_xydata(), (tip, look_at.place)) for line in film.axes.lines)


def test_a_video_needs_its_encoder(plan: PlanDrawing, monkeypatch: pytest.MonkeyPatch) -> None:
    """With ffmpeg there is an MP4 file; without it the message says what is missing."""
    if video.encoder() is not None:
        content = motion_mp4(plan, replace(FILM, video_side=120, video_frames_a_second=10))
        assert content[4:8] == b"ftyp"
    monkeypatch.setattr(video, "encoder", lambda: None)
    with pytest.raises(ProblemError, match="ffmpeg, which is not found"):
        motion_mp4(plan)


def test_a_folder_has_all_that_pictures_show(measured: Solution, folder: Path) -> None:
    """Curves, least gap and simulated arm come back from the folder as they were."""
    problem = measured.problem
    motion = load_motion(folder, problem.arm)
    curves = recorded_curves(motion.arrays, problem.arm)
    assert len(curves) == len(measured.path.curves)
    arc = np.linspace(0.0, problem.arm.length, 9)
    for one, other in zip(curves, measured.path.curves, strict=True):
        np.testing.assert_allclose(one.positions_at(arc), other.positions_at(arc), atol=1e-12)
    assert measured.room is not None
    assert recorded_nearest(folder) == measured.room.nearest
    np.testing.assert_array_equal(motion.simulated_angles, measured.simulation.angles)


@pytest.mark.drawn(20, of="dear tests")
@pytest.mark.planning
def test_draw_makes_all_figures_of_a_folder(folder: Path, plan: PlanDrawing, tmp_path: Path) -> None:
    """Every still figure is written, that of the motion the same as from the solution; --out gathers them by plan."""
    result = CliRunner().invoke(app, ["draw", str(folder)])
    assert result.exit_code == 0, result.output
    names = [f"{name}.png" for name in STILL_FIGURES]
    assert {path.name for path in folder.glob("*.png")} == set(names)
    assert set(names) <= WRITTEN_FILES
    assert (folder / "plan.png").read_bytes() == plan_picture(plan)
    options = ["--figure", "links", "--figure", "gif", "--figure-format", "svg", "--out", str(tmp_path / "paper")]
    assert CliRunner().invoke(app, ["draw", str(folder), *options]).exit_code == 0
    drawn = tmp_path / "paper" / "small"
    assert {path.name for path in drawn.iterdir()} == {"links.svg", "motion.gif"}
    assert (drawn / "links.svg").read_bytes().startswith(b"<?xml")


def test_draw_says_what_it_cannot_draw(folder: Path, tmp_path: Path) -> None:
    """A folder that is none, and curves that a folder has not, are bad input; so is an unknown figure."""
    assert CliRunner().invoke(app, ["draw", str(tmp_path / "nothing")]).exit_code == 2
    assert CliRunner().invoke(app, ["draw", str(folder), "--figure", "mona-lisa"]).exit_code == 2
    with np.load(folder / "solution.npz") as arrays:
        kept = {name: arrays[name] for name in arrays.files if not name.startswith("segment")}
    np.savez(folder / "solution.npz", **kept)
    with pytest.raises(ProblemError):
        draw_figures(folder, [FigureName.CURVES])
