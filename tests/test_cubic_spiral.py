"""Cubic spirals against their closed forms (section 4.1)."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad, solve_ivp

from ccm_opt.core.polyline import wrap
from ccm_opt.planning.baseline.curve_track import chord_ratio
from tests.oracles.cubic_spiral import CubicSpiral

COORDINATE = st.floats(-2.0, 2.0)
POINT = st.tuples(COORDINATE, COORDINATE).map(np.array)
HEADING = st.floats(-3.1, 3.1)
TURN = st.floats(0.01, 3.9) | st.floats(-3.9, -0.01)


def direction(heading: float) -> np.ndarray:
    """The unit vector of a heading."""
    return np.array([np.cos(heading), np.sin(heading)])


@pytest.mark.parametrize(("turn", "ratio"), [(0.0, 1.0), (np.pi / 2, 0.855802), (np.pi, 0.486076)])
def test_chord_ratios_are_those_of_kanayama_and_hartman(turn: float, ratio: float) -> None:
    """D(π/2) and D(π) to the six digits of their table."""
    assert chord_ratio(turn) == pytest.approx(ratio, abs=5e-7)


@given(turn=st.floats(-20.0, 20.0))
def test_the_chord_ratio_is_an_integral_to_twelve_digits(turn: float) -> None:
    """D agrees with adaptive quadrature of its definition."""
    value, _ = quad(lambda x: 2.0 * np.cos(turn * (1.5 - 2.0 * x**2) * x), 0.0, 0.5, epsabs=1e-13, epsrel=1e-13)
    assert chord_ratio(turn) == pytest.approx(value, abs=1e-12)
    assert chord_ratio(-turn) == chord_ratio(turn)


@settings(max_examples=40, deadline=None)
@given(start=POINT, heading=HEADING, turn=TURN, length=st.floats(0.1, 3.0))
def test_a_cubic_spiral_solves_the_equations_of_its_curvature(
    start: np.ndarray, heading: float, turn: float, length: float
) -> None:
    """Integrating κ(s) = 6 α s (ℓ - s)/ℓ³ twice leads to the same end; chord and tangents are those of the law."""
    spiral = CubicSpiral(start, heading, turn, length)
    path = solve_ivp(
        lambda s, y: [np.cos(y[2]), np.sin(y[2]), 6.0 * turn / length**3 * s * (length - s)],
        (0.0, length),
        [*start, heading],
        rtol=1e-10,
        atol=1e-12,
    )
    np.testing.assert_allclose(path.y[:2, -1], spiral.end, atol=1e-8)
    assert path.y[2, -1] == pytest.approx(spiral.end_heading)
    np.testing.assert_allclose(spiral.positions_at(np.array([0.0, length]))[1], spiral.end, atol=1e-11)
    np.testing.assert_array_equal(spiral.curvature_at(np.array([0.0, length])), 0.0)
    assert spiral.curvature_at(np.array(0.5 * length)) == pytest.approx(spiral.peak_curvature)
    assert spiral.peak_curvature == pytest.approx(1.5 * turn / length)
    chord = spiral.end - start
    assert np.hypot(*chord) == pytest.approx(length * chord_ratio(turn))
    for tangent, angle in ((heading, -0.5 * turn), (spiral.end_heading, 0.5 * turn)):
        assert wrap(tangent - float(np.arctan2(chord[1], chord[0])) - angle) == pytest.approx(0.0, abs=1e-9)


@given(turn=TURN, length=st.floats(0.1, 3.0), share=st.floats(0.0, 1.0))
def test_a_turn_is_its_own_mirror_image(turn: float, length: float, share: float) -> None:
    """Seen from the middle, heading is odd and curvature even; travelled backwards it is the same turn."""
    spiral = CubicSpiral(np.zeros(2), 0.3, turn, length)
    there, back = share * length, (1.0 - share) * length
    headings = spiral.heading_at(np.array([there, back]))
    assert headings.sum() == pytest.approx(spiral.heading + spiral.end_heading)
    curvatures = spiral.curvature_at(np.array([there, back]))
    assert curvatures[0] == pytest.approx(curvatures[1], abs=1e-9)
    reverse = CubicSpiral(spiral.end, spiral.end_heading + np.pi, -turn, length)
    np.testing.assert_allclose(reverse.end, spiral.start, atol=1e-12)


def test_jerk_is_the_integral_of_the_squared_slope_of_curvature() -> None:
    """12 α²/ℓ³, and a curve of the same turn with a bump has more."""
    spiral, s = CubicSpiral(np.zeros(2), 0.0, 1.2, 0.7), np.linspace(0.0, 0.7, 20_001)
    slope = np.gradient(spiral.curvature_at(s), s)
    assert np.trapezoid(slope**2, s) == pytest.approx(spiral.jerk, rel=1e-6)
    bumped = spiral.curvature_at(s) + 0.1 * np.sin(2.0 * np.pi * s / 0.7)
    assert np.trapezoid(np.gradient(bumped, s) ** 2, s) > spiral.jerk
