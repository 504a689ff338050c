"""Pictures of plans in space: what the renderer shows and hides, and goals with their numbers."""

from dataclasses import replace

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.problem import Stop, TipGoal, Tolerances
from ccm_opt.scene.bodies import BoxBody, SphereBody
from ccm_opt.viz import figure_files as style
from ccm_opt.viz.arm_drawing import SIDES, PlanDrawing
from ccm_opt.viz.films import SPACE_FILM, make_film
from ccm_opt.viz.plan import draw_goals
from ccm_opt.viz.raster import FlatTriangles
from ccm_opt.viz.scene_views import seen_from, viewing_side
from ccm_opt.viz.shading import Faces, ShadedView, Tube

from .space_folders import solved

ARM = Tube(np.array([[-0.4, 0.0, 0.0], [0.0, 0.0, 0.1], [0.4, 0.0, 0.0]]), 0.05, style.GOAL_ARM)
FRONT = seen_from(-90.0, 0.0)
WINDOW = np.array([[-1.0, -1.0], [1.0, 1.0]])


def picture(*bodies: tuple[FloatArray, IntArray]) -> FloatArray:
    """The picture of the arm among bodies, from the front, of 80 by 80 pixels."""
    view = ShadedView(Faces.of_bodies(bodies), FRONT, WINDOW, 80, [ARM])
    return view.picture(view.shown)


def bluish(shown: FloatArray) -> int:
    """The number of pixels that are clearly nearer to the arm's colour than to grey."""
    return int(np.count_nonzero(shown[..., 2] - shown[..., 0] > 0.3 * np.ptp(to_rgb(style.GOAL_ARM))))


@given(arrays(np.float64, (4, 2), elements=st.floats(-3.0, 23.0)))
def test_triangles_with_a_common_side_share_no_pixel(corners: FloatArray) -> None:
    """Each pixel within a convex quadrilateral belongs to just one of the two triangles that it is divided into."""
    middle = corners.mean(axis=0)
    ring = corners[np.argsort(np.arctan2(*(corners - middle).T))]
    (ux, uy), (vx, vy) = (np.roll(ring, -1, axis=0) - ring).T, (np.roll(ring, -2, axis=0) - np.roll(ring, -1, axis=0)).T
    halves = ring[[[0, 1, 2], [0, 2, 3]]]
    nothing = np.full((20, 20), -np.inf, dtype=np.float32)
    drawn = [
        FlatTriangles(some, np.zeros((len(some), 3)), np.ones((len(some), 3)), np.zeros(len(some), dtype=np.intp), 1)
        for some in (halves[:1], halves[1:], halves)
    ]
    one, other, both = (triangles.nearest(nothing) for triangles in drawn)
    covered = both.owner == 0
    assert np.array_equal(covered, (one.owner == 0) | (other.owner == 0))
    if np.all(ux * vy - uy * vx > 1e-6):
        assert both.fragments[0] == np.count_nonzero(covered)
    centres = np.argwhere(covered)[:, ::-1] + 0.5
    assert np.all(centres >= corners.min(axis=0) - 1e-9)
    assert np.all(centres <= corners.max(axis=0) + 1e-9)


def test_an_arm_is_drawn_over_what_is_part_of_every_picture() -> None:
    """A path that is part of every picture stays beside the arm, also in the part of a film's frame that changes."""
    path = Tube(np.array([[-0.4, 0.2, 0.3], [0.4, 0.2, -0.3]]), 0.02, style.TIP_PATH)
    view = ShadedView(Faces.of_bodies([]), FRONT, WINDOW, 80, [path, ARM], [path])
    rows, columns, part = view.part([ARM])
    without = view.picture(())[rows, columns]
    beside = np.all(ShadedView(Faces.of_bodies([]), FRONT, WINDOW, 80, []).part([ARM])[2] == 1.0, axis=2)
    assert np.allclose(part[beside], without[beside], atol=1e-6)
    assert np.count_nonzero(without[beside] < 0.99) > 50
    assert bluish(part) > 0.9 * bluish(picture())


def test_an_arm_in_a_closed_box_is_seen_through_its_front() -> None:
    """A box around the arm is open to the viewer; a box behind the arm, and one beside, hide nothing and stay solid."""
    alone = bluish(picture())
    assert alone > 100
    around = BoxBody(np.array([-0.6, -0.3, -0.3]), np.array([0.6, 0.3, 0.3])).surface(12)
    behind = BoxBody(np.array([-0.6, 0.2, -0.3]), np.array([0.6, 0.3, 0.3])).surface(12)
    assert bluish(picture(around)) > 0.8 * alone
    assert bluish(picture(behind)) > 0.95 * alone
    # The back wall is seen, in its own colour and not through glass.
    assert np.allclose(picture(behind)[48, 40], picture(around)[48, 40], atol=0.05)


def test_a_ball_beside_the_arm_hides_what_is_behind_it() -> None:
    """What hides no part of the arm is solid, in front of the arm too."""
    ball = SphereBody(np.array([0.0, -0.5, 0.6]), 0.2).surface(24)
    wall = BoxBody(np.array([-0.9, 0.5, -0.9]), np.array([0.9, 0.6, 0.9])).surface(12)
    with_ball, without = picture(ball, wall), picture(wall)
    centre = (64, 40)
    assert np.abs(with_ball - without)[56:73, 32:49].max() > 0.05
    assert np.allclose(picture(ball)[centre], with_ball[centre], atol=1e-6)


def test_a_part_of_the_picture_is_that_of_the_whole() -> None:
    """A frame of a film, drawn where the arm is, equals the same part of the whole picture, which is else unchanged."""
    around = BoxBody(np.array([-0.6, -0.3, -0.3]), np.array([0.6, 0.3, 0.3])).surface(12)
    view = ShadedView(Faces.of_bodies([around]), viewing_side(ARM.points), WINDOW, 80, [ARM])
    whole, empty = view.picture(view.shown), view.picture([])
    rows, columns, part = view.part([ARM])
    empty[rows, columns] = part
    assert np.allclose(empty, whole, atol=1e-6)


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


def test_frames_of_any_size_hold_the_picture() -> None:
    """Frames are as large as video encoders need them, whatever the number of pixels of the picture is."""
    plan = PlanDrawing.from_solution(solved())
    for side in range(60, 68):
        film = make_film(plan, replace(SPACE_FILM, longest_side=side, most_frames=2))
        for frame in film.frames():
            assert frame.width >= side
            assert frame.width % 2 == frame.height % 2 == 0
