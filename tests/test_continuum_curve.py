"""Laws and oracles of the curvature curve (paper, section 2.1)."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad, solve_ivp
from scipy.interpolate import CubicSpline
from scipy.special import j0

from ccm_opt.core.arrays import FloatArray
from ccm_opt.robot.configuration import Configuration
from ccm_opt.robot.segment import CurvatureSegment

curvatures = st.lists(st.floats(-12.0, 12.0), min_size=5, max_size=5).map(np.array)
gaps = st.lists(st.floats(0.3, 1.0), min_size=4, max_size=4).map(np.array)


def knots_of(widths: FloatArray) -> tuple[float, float, float]:
    """Three inner knots from four positive gaps."""
    return tuple((np.cumsum(widths)[:3] / widths.sum()).tolist())


def random_chain(seed: int, segments: int) -> Configuration:
    """A chain with continuous curvature."""
    rng = np.random.default_rng(seed)
    values = rng.normal(0.0, 5.0, 4 * segments + 1)
    pieces = [values[4 * k : 4 * k + 5] for k in range(segments)]
    knots = [knots_of(rng.uniform(0.3, 1.0, 4)) for _ in range(segments)]
    lengths = rng.uniform(0.2, 0.6, segments).tolist()
    return Configuration.chain(rng.normal(size=2), rng.uniform(-3, 3), lengths, pieces, knots)


@given(curvatures, gaps)
@settings(max_examples=40, deadline=None)
def test_curvature_is_the_natural_cubic_spline(values: FloatArray, widths: FloatArray) -> None:
    """The curvature of a segment is SciPy's natural cubic spline through its five points."""
    segment = CurvatureSegment(0.7, 0.0, values, knots_of(widths))
    arc = np.linspace(0.0, 0.7, 57)
    oracle = CubicSpline(segment.breakpoints, values, bc_type="natural")(arc)
    np.testing.assert_allclose(segment.spline(arc), oracle, atol=1e-10)


@pytest.mark.parametrize("seed", range(5))
def test_curve_solves_its_differential_equation(seed: int) -> None:
    """Positions and headings agree with an adaptive Runge-Kutta integration of θ' = κ, x' = cos θ, y' = sin θ."""
    chain = random_chain(seed, 3)
    arc = np.linspace(0.0, chain.length, 41)

    def slope(s: float, state: FloatArray) -> list[float]:
        return [np.cos(state[2]), np.sin(state[2]), float(chain.curvature_at(np.array([s]))[0])]

    start = [*chain.base, chain.base_heading]
    oracle = solve_ivp(slope, (0.0, chain.length), start, t_eval=arc, rtol=1e-10, atol=1e-11, max_step=0.02)
    np.testing.assert_allclose(chain.positions_at(arc), oracle.y[:2].T, atol=1e-7)
    np.testing.assert_allclose(chain.heading_at(arc), oracle.y[2], atol=1e-7)


@pytest.mark.parametrize(("a1", "a2"), [(0.6, 0.4), (-1.2, 0.9), (0.0, 2.0)])
def test_spline_fit_converges_to_the_modal_curve(a1: float, a2: float) -> None:
    """Splines through a modal curve converge to its closed-form tip J₀(√(a₁²+a₂²))(sin a₂, cos a₂)."""
    oracle = j0(np.hypot(a1, a2)) * np.array([np.sin(a2), np.cos(a2)])
    errors = []
    for count in (16, 32, 64):
        s = np.linspace(0.0, 1.0, 4 * count + 1)
        kappa = -2.0 * np.pi * (a1 * np.cos(2.0 * np.pi * s) + a2 * np.sin(2.0 * np.pi * s))
        pieces = [kappa[4 * k : 4 * k + 5] for k in range(count)]
        chain = Configuration.chain(np.zeros(2), np.pi / 2, [1.0 / count] * count, pieces)
        errors.append(np.hypot(*(chain.tip[0] - oracle)))
    assert errors[-1] < 1e-5
    assert errors[1] / errors[2] == pytest.approx(4.0, rel=0.1)  # second order: natural ends do not know κ''


@given(st.integers(0, 10_000), st.integers(1, 4))
@settings(max_examples=25, deadline=None)
def test_changed_sign_of_curvature_mirrors_the_curve(seed: int, segments: int) -> None:
    """C → -C with the base heading on the x-axis mirrors the curve in that axis."""
    chain = random_chain(seed, segments)
    plain, flipped = (
        Configuration.chain(
            np.zeros(2),
            0.0,
            [s.length for s in chain.segments],
            [sign * s.curvature for s in chain.segments],
            [s.knots for s in chain.segments],
        )
        for sign in (1.0, -1.0)
    )
    arc = np.linspace(0.0, chain.length, 33)
    np.testing.assert_allclose(flipped.positions_at(arc), plain.positions_at(arc) * [1.0, -1.0], atol=1e-12)


def test_circle_closes() -> None:
    """A constant curvature 2π over unit length is a full circle back to its base."""
    chain = Configuration.chain(np.array([1.0, 2.0]), 0.3, [1.0], [np.full(5, 2.0 * np.pi)])
    np.testing.assert_allclose(chain.tip[0], [1.0, 2.0], atol=1e-12)
    assert chain.tip[1] == pytest.approx(0.3 + 2.0 * np.pi)


@pytest.mark.parametrize("seed", range(3))
def test_heading_integral_is_exact(seed: int) -> None:
    """The integral of the heading agrees with adaptive quadrature."""
    chain = random_chain(seed, 2)
    arc = np.array([0.1, 0.37, chain.length])
    oracle = [
        quad(lambda s: float(chain.heading_at(np.array([s]))[0]), 0.0, end, points=chain.breakpoints[1:-1], limit=200)[
            0
        ]
        for end in arc
    ]
    np.testing.assert_allclose(chain.heading_integral_at(arc), oracle, atol=1e-9)


@pytest.mark.parametrize(
    ("length", "values", "knots"),
    [
        (0.0, np.zeros(5), (0.25, 0.5, 0.75)),
        (1.0, np.zeros(4), (0.25, 0.5, 0.75)),
        (1.0, np.zeros(5), (0.5, 0.5, 0.75)),
    ],
)
def test_malformed_segment_is_refused(length: float, values: FloatArray, knots: tuple[float, float, float]) -> None:
    """A segment without length, with other than five values or with knots out of order is a ValueError."""
    with pytest.raises(ValueError, match=r"segment|knots"):
        CurvatureSegment(length, 0.0, values, knots)
