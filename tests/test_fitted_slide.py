"""Curves that show an arm being fed along: how near they come to the joints, and how still they lie."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ccm_opt.core.arrays import FloatArray
from ccm_opt.planning.curve_map import SETTLING, CurveMap
from ccm_opt.planning.followable_ways import STILL, feeds_to_end, fitted_slide, slid_along
from ccm_opt.planning.guides import ArmTrack
from ccm_opt.robot.arm import Arm
from tests.test_slid_along import bent_way, fed_arm

slides = st.tuples(st.sampled_from([6, 8, 12, 24]), st.floats(0.1, 0.2), st.floats(0.2, 1.4), st.floats(-np.pi, np.pi))


def slide(links: int, radius: float, turn: float, azimuth: float) -> tuple[Arm, FloatArray]:
    """An arm fed along a bent way, and its configurations."""
    arm = fed_arm(links)
    track = ArmTrack.behind(arm.joint_positions_at(np.zeros(2 * links + 1)), bent_way(radius, turn, azimuth))
    return arm, slid_along(arm, track, feeds_to_end(arm, track, 0.0, 0.02))


def shown(curve: CurveMap, unknowns: FloatArray, configurations: FloatArray) -> float:
    """What is missed of the joints' turns, with the curve's own unevenness: a sum of squares."""
    wrong = np.stack([curve.configuration(v) for v in unknowns]) - configurations
    knots = unknowns[1:, : 2 * curve.knots].reshape(-1, 2, curve.knots)
    return float(np.sum(wrong**2) + np.sum((SETTLING * np.diff(knots, axis=2)) ** 2))


def moved(curve: CurveMap, unknowns: FloatArray) -> float:
    """The sum of squares of the changes of the curve's bends."""
    return float(np.sum((curve.nominal_length * np.diff(unknowns, axis=0) @ curve.curvature_rows.T) ** 2))


@settings(max_examples=20, deadline=None)
@given(slides, st.sampled_from([11, 16, 22]), st.integers(0, 2**32 - 1))
def test_a_fit_is_the_best_of_both(case: tuple[int, float, float, float], knots: int, seed: int) -> None:
    """No other curves show the joints as well and lie as still; the start stays, and the feed is that of the slide."""
    arm, configurations = slide(*case)
    curve, start = CurveMap.through(arm, configurations[0], knots)
    unknowns = fitted_slide(curve, start, configurations)
    assert np.array_equal(unknowns[0], start)
    assert unknowns @ np.eye(curve.dimension)[-1] * curve.scale[-1] == pytest.approx(configurations[:, -1])

    def cost(some: FloatArray) -> float:
        return shown(curve, some, configurations) + STILL * moved(curve, some)

    least = cost(unknowns)
    rng = np.random.default_rng(seed)
    for size in (1e-3, 1e-2, 0.1):
        aside = np.zeros_like(unknowns)
        aside[1:, : 2 * knots] = size * rng.normal(size=(len(unknowns) - 1, 2 * knots))
        assert cost(unknowns + aside) >= least * (1.0 - 1e-9)


@settings(max_examples=20, deadline=None)
@given(slides)
def test_curves_lie_stiller_than_those_of_each_configuration(case: tuple[int, float, float, float]) -> None:
    """As the best of both must."""
    arm, configurations = slide(*case)
    curve, start = CurveMap.through(arm, configurations[0], 22)
    alone = np.stack([start, *(curve.fitted(q) for q in configurations[1:])])
    together = fitted_slide(curve, start, configurations)
    assert moved(curve, together) <= moved(curve, alone) * (1.0 + 1e-9)
