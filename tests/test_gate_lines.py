"""Lines across gates: where they are, what they say of poses, and Newton's method onto their middles."""

import numpy as np
import pytest
import shapely
from hypothesis import assume, given
from hypothesis import strategies as st

from ccm_opt.core.arrays import FloatArray
from ccm_opt.planning.limits import gate_rails
from ccm_opt.planning.limits.gate_rails import GateLines, GateRails
from ccm_opt.planning.link_space import LinkSpace
from ccm_opt.planning.swept_motion import PlanarSweep
from ccm_opt.scene.workspace import Obstacle, PlaneShape, Workspace
from tests.scenes import ROOM, make_arm

WALL_X = 0.4
HALF = 0.021
bows = st.tuples(st.floats(-1.5, 1.5), st.floats(-1.5, 1.5), st.floats(-2e-3, 2e-3))


def flat_gate(thick: float) -> Workspace:
    """A wall of some thickness across the room, with a gate in it."""
    sides = (shapely.box(WALL_X, HALF, WALL_X + thick, 1.4), shapely.box(WALL_X, -1.4, WALL_X + thick, -HALF))
    return Workspace(ROOM, tuple(Obstacle(f"side {k}", PlaneShape(side)) for k, side in enumerate(sides)))


def round_gate(radius: float) -> Workspace:
    """Two round posts with a gate between them."""
    posts = [shapely.Point(WALL_X, side * (HALF + radius)) for side in (-1.0, 1.0)]
    return Workspace(ROOM, tuple(Obstacle(f"post {k}", PlaneShape(post, radius)) for k, post in enumerate(posts)))


def lines_of(workspace: Workspace, thick: float = 0.02) -> GateLines:
    """The lines of a gate whose rail is the x-axis, with runs of 30 mm."""
    x = np.array([WALL_X - 0.04, WALL_X - 0.01, WALL_X + thick + 0.01, WALL_X + thick + 0.04])
    return GateLines.from_rails((np.column_stack((x, 0.0 * x)),), workspace)


def bowed(bow: tuple[float, float, float]) -> tuple[LinkSpace, FloatArray]:
    """A pose that lies about the x-axis, bent a little along its length, begun a little off it; and its space."""
    arm = make_arm(24)
    lift = bow[2] / WALL_X
    headings = lift + 0.006 * np.sin(bow[0] + np.linspace(0.0, 6.0, arm.links)) + 0.006 * bow[1]
    return LinkSpace.through(arm, arm.bends(headings))


@pytest.mark.parametrize("thick", [0.02, 0.04])
def test_a_thick_gate_has_a_line_at_either_face(thick: float) -> None:
    """Between its faces a thick gate is equally narrow: lines stand at both, a hair apart from them at most."""
    lines = lines_of(flat_gate(thick), thick)
    np.testing.assert_allclose(lines.middles[:, 1], 0.0, atol=1e-12)
    np.testing.assert_allclose(lines.middles[:, 0], [WALL_X, WALL_X + thick], atol=0.05 * thick + 1e-3)
    np.testing.assert_allclose(lines.along, [[1.0, 0.0], [1.0, 0.0]])


def test_a_gate_between_posts_has_one_line() -> None:
    """Round walls are nearest at one place; before and behind there is room aside that no line may take away."""
    lines = lines_of(round_gate(0.02), 0.0)
    np.testing.assert_allclose(lines.middles, [[WALL_X, 0.0]], atol=1e-3)


@given(bows)
def test_slopes_are_derivatives(bow: tuple[float, float, float]) -> None:
    """Slopes of the crossings agree with finite differences while the same links cross."""
    lines = lines_of(flat_gate(0.02))
    space, v = bowed(bow)
    found = lines.crossings(space.pose(v).points[None], 1.0)
    assert found.crossed.all()
    assume(np.all((found.share > 1e-3) & (found.share < 1.0 - 1e-3)))
    slopes = lines.slopes(space.pose(v).moving[None], space.arm.headings(space.configurations(v))[None], found)[0]
    step = 1e-6
    for k in range(0, len(v), 5):
        moved = [v + sign * step * np.eye(len(v))[k] for sign in (1.0, -1.0)]
        aside = [lines.crossings(space.pose(each).points[None], 1.0).aside[0] for each in moved]
        np.testing.assert_allclose(slopes[:, k], (aside[0] - aside[1]) / (2.0 * step), rtol=1e-4, atol=1e-6)


@given(bows)
def test_restored_poses_cross_in_the_middle(bow: tuple[float, float, float]) -> None:
    """Newton's method ends in the middle of every line, or leaves the pose as it was; there it changes nothing."""
    lines = lines_of(flat_gate(0.02))
    space, v = bowed(bow)
    near = lines.crossings(space.pose(v).points[None], gate_rails._ACROSS * space.nominal_length)
    restored = lines.restored(space, v[None])[0]
    if np.array_equal(restored, v):
        # It stood there already, or would have had to turn too far.
        assert np.max(np.abs(near.aside)) <= 10.0 * gate_rails._EXACT or np.max(np.abs(near.aside)) > 1e-3
        return
    axis = shapely.LineString(space.pose(restored).points)
    for (x, y), crossed in zip(lines.middles, near.crossed[0], strict=True):
        across = shapely.get_coordinates(axis.intersection(shapely.LineString([(x, -1.0), (x, 1.0)])))
        assert not crossed or abs(across[0, 1] - y) < 20.0 * gate_rails._EXACT
    np.testing.assert_allclose(lines.restored(space, restored[None])[0], restored, atol=1e-9)


@given(bows)
def test_a_step_takes_a_crossing_towards_the_middle(bow: tuple[float, float, float]) -> None:
    """The rails' equations ask for the way back to first order, and the ends of a motion are left where they stand."""
    lines = lines_of(flat_gate(0.02))
    space, v = bowed(bow)
    limit = GateRails((np.array([[0.3, 0.0], [0.5, 0.0]]),), lines, 0.0)
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(gate_rails, "_CATCHING_UP", 1.0)
        rows, change = limit.missed(space, space.pose(v))
    moved = v + np.linalg.pinv(rows) @ change
    before = lines.crossings(space.pose(v).points[None], 1.0).aside[0]
    after = lines.crossings(space.pose(moved).points[None], 1.0).aside[0]
    # To first order: what is left is of second order, and of the kink where a line is crossed by another link.
    assert np.max(np.abs(after)) <= 0.5 * np.max(np.abs(before)) + 1e-5
    sweep = PlanarSweep(space, np.array([v, v, v, v]))
    (equations,) = limit.keyframe_equations(sweep, np.linspace(0.0, 1.0, 4))
    assert set(equations.keyframe) <= {1, 2}
    kept = limit.restored_keyframes(space, sweep.unknowns, np.linspace(0.0, 1.0, 4))
    np.testing.assert_array_equal(kept[[0, -1]], sweep.unknowns[[0, -1]])


def test_links_in_a_gate_are_told_from_those_beside_it() -> None:
    """Links whose axis is within a radius of the gate's are in it; those before the wall are not."""
    lines = lines_of(flat_gate(0.02))
    space, v = bowed((0.0, 0.0, 0.0))
    points = space.pose(v).points
    inside = lines.holds_links(points[None], space.arm.radii)[0]
    assert inside.any()
    starts = points[:-1, 0]
    assert np.all(starts[inside] < WALL_X + 0.02 + 0.01 + space.arm.radius)
    assert not inside[starts < WALL_X - 0.01 - space.arm.radius - space.arm.link_length].any()
