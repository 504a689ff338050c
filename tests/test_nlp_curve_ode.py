"""The CasADi curve against NumPy, and the certified rows against dense sweeps."""

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ccm_opt.core.arrays import FloatArray
from ccm_opt.ik import curve_program as constraints
from ccm_opt.ik.curve_program import CONTROLS, STATES, SUBSTEPS, SegmentFlow, segment_function
from ccm_opt.robot.configuration import Configuration
from ccm_opt.robot.segment import PIECES
from tests.nlp_corridors import region

seeds = st.integers(0, 100_000)


def random_stage(seed: int, bend: float = 5.0) -> tuple[FloatArray, FloatArray]:
    """A state and a control of random shape; the bounds B are random too."""
    rng = np.random.default_rng(seed)
    state = np.concatenate((rng.normal(size=2), rng.uniform(-3, 3, 1), rng.normal(0, bend, 1), [0.2]))
    control = np.concatenate((rng.normal(0, bend, 4), rng.uniform(0.04, 0.12, 4), rng.uniform(0, 2 * bend, 4)))
    return state, control


def as_curve(state: FloatArray, control: FloatArray) -> Configuration:
    """The same segment for NumPy's kinematics."""
    widths = control[4:8]
    knots = np.cumsum(widths)[:3] / widths.sum()
    values = np.append(state[3], control[:4])
    return Configuration.chain(state[:2], float(state[2]), [widths.sum()], [values], [tuple(knots.tolist())])


def evaluate(state: FloatArray, control: FloatArray) -> list[FloatArray]:
    """End state, points, Bernstein coefficients and ∫κ² as arrays."""
    return [np.array(value) for value in segment_function()(state, control)]


@given(seeds)
@settings(max_examples=40, deadline=None)
def test_casadi_curve_equals_numpy_kinematics(seed: int) -> None:
    """End state, points and bending of the symbolic segment agree with NumPy: 4e-6 in position, exact else."""
    state, control = random_stage(seed)
    end, points, _, bending = evaluate(state, control)
    curve = as_curve(state, control)
    tip, heading = curve.tip
    exact = [heading, control[3], 0.2 + curve.length]
    arcs = np.concatenate(
        [start + np.arange(2) * a / 2 for start, a in zip(curve.breakpoints, control[4:8], strict=False)]
    )
    dense = np.linspace(0.0, curve.length, 20_001)
    np.testing.assert_allclose(end[:2, 0], tip, atol=4e-6)
    np.testing.assert_allclose(end[2:, 0], exact, atol=1e-12)
    np.testing.assert_allclose(points.T, curve.positions_at(np.append(arcs, curve.length)), atol=4e-6)
    assert float(bending[0, 0]) == pytest.approx(np.trapezoid(curve.curvature_at(dense) ** 2, dense), rel=1e-5)


@given(seeds)
@settings(max_examples=40, deadline=None)
def test_bernstein_coefficients_bound_the_curvature(seed: int) -> None:
    """On every piece the largest |Bernstein coefficient| is a bound of |κ|, and not a wasteful one."""
    state, control = random_stage(seed)
    bound = np.abs(evaluate(state, control)[2]).max(axis=1)
    curve = as_curve(state, control)
    for i, (start, end) in enumerate(zip(curve.breakpoints[:-1], curve.breakpoints[1:], strict=True)):
        peak = np.abs(curve.curvature_at(np.linspace(start, end, 200)[:-1])).max()
        assert peak <= bound[i] + 1e-9
        assert bound[i] <= 4.0 * peak + 1e-9


def rows_of(
    state: FloatArray,
    control: FloatArray,
    normals: FloatArray,
    offsets: FloatArray,
    ends: tuple[bool, bool] = (False, False),
) -> tuple[FloatArray, ...]:
    """Values of the certified curvature and containment rows."""
    x, u = ca.SX.sym("x", STATES), ca.SX.sym("u", CONTROLS)
    flow = SegmentFlow(*segment_function()(x, u))
    curvature = constraints.certified_curvature(0, u, flow).expression
    inside = constraints.certified_containment(0, u, flow, ca.SX(normals), ca.SX(offsets), ends).expression
    values = ca.Function("rows", [x, u], [curvature, inside])(state, control)
    return tuple(np.array(value).ravel() for value in values)


@given(seeds, st.booleans(), st.booleans())
@settings(max_examples=40, deadline=None)
def test_certified_rows_really_bound_the_curve(seed: int, base: bool, tip: bool) -> None:
    """Whenever all certified rows hold, a dense sweep of the curve is inside the region and below the bounds."""
    rng = np.random.default_rng(seed)
    state, control = random_stage(seed, bend=6.0)
    control[8:] = np.abs(evaluate(state, control)[2]).max(axis=1) + 1e-12
    angles = np.sort(rng.uniform(0.0, 2.0 * np.pi, 3)) + np.array([0.0, 0.7, 1.4])
    normals = np.column_stack((np.cos(angles), np.sin(angles)))
    _, slack = rows_of(state, control, normals, np.zeros(3), (base, tip))
    # The tightest half-planes that the rows accept: shift each until its worst row is exactly zero.
    offsets = -slack.reshape(-1, 3).min(axis=0)
    curvature, inside = rows_of(state, control, normals, offsets, (base, tip))
    curve = as_curve(state, control)
    sweep = curve.positions_at(np.linspace(0.0, curve.length, 2_000))
    assert min(curvature.min(), inside.min()) > -1e-9
    assert (sweep @ normals.T - offsets).max() < 4e-6


def test_containment_rows_carry_the_sagitta() -> None:
    """The margin of a sub-step is B h²/8, the sagitta's bound, at both of its ends."""
    state, control = random_stage(1)
    square = region(np.array([[-9.0, -9.0], [9.0, -9.0], [9.0, 9.0], [-9.0, 9.0]]))
    _, with_margin = rows_of(state, control, square.normals, square.offsets)
    points = evaluate(state, control)[1]
    for i in range(PIECES):
        margin = control[8 + i] * (control[4 + i] / SUBSTEPS) ** 2 / 8
        for j in range(SUBSTEPS + 1):
            row = with_margin[4 * (3 * i + j) : 4 * (3 * i + j + 1)]
            np.testing.assert_allclose(row, 9.0 - square.normals @ points[:, 2 * i + j] - margin, atol=1e-12)
