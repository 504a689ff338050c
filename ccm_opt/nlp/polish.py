"""From the NLP's numbers to a configuration in metres, its tip brought onto the goal by Newton's method."""

from dataclasses import dataclass

import numpy as np

from ccm_opt.continuum.configuration import Configuration
from ccm_opt.continuum.segment import POWERS, Knots
from ccm_opt.continuum.spline import piece_coefficients
from ccm_opt.ground.angles import unit_vector
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.nlp.multiple_shooting import ConfigurationNLP, unpack_variables

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(16)
"""Gauss points of a piece."""


@dataclass(frozen=True)
class HeadingBasis:
    """θ at quadrature nodes, linear in the curvature values of a chain: θ = θ_0 + rows @ values.

    Attributes:
        rows: at the nodes, shape (nodes, values) [m].
        weights: ∫ f ds = weights @ f(nodes), shape (nodes,) [m].
        tip: the same row at the chain's end, shape (values,) [m].
    """

    rows: FloatArray
    weights: FloatArray
    tip: FloatArray


def polished_configuration(nlp: ConfigurationNLP, variables: FloatArray) -> Configuration:
    """The configuration of a solution with tip position, heading and length exact.

    Args:
        nlp: the NLP solved.
        variables: its solution.

    Returns:
        In metres; with a mount the first segment is its straight stub.
    """
    task = nlp.task
    states, controls = unpack_variables(variables)
    widths = controls[:, 4:8] * (task.length - task.stub) / controls[:, 4:8].sum()
    values = np.append(states[0, 3], controls[:, :4]) / task.length
    heading, values = _newton(nlp, widths, float(states[0, 2]), values)
    curvatures = [values[4 * k : 4 * k + 5] for k in range(len(widths))]
    lengths = widths.sum(axis=1).tolist()
    knots = [_knots(row) for row in widths]
    if task.stub > 0.0:
        lengths = [task.stub, *lengths]
        curvatures = [np.zeros(5), *curvatures]
        knots = [(0.25, 0.5, 0.75), *knots]
    return Configuration.chain(task.base, heading, lengths, curvatures, knots)


def heading_basis(widths: FloatArray) -> HeadingBasis:
    """The linear map from the 4 K + 1 curvature values of a chain to its headings.

    Args:
        widths: arc lengths between knots, shape (K, 4) [m].
    """
    count = 4 * len(widths) + 1
    start = np.zeros(count)
    rows = []
    weights = []
    for k, row in enumerate(widths):
        for width, coefficients in zip(row, piece_coefficients(row, np.eye(5)), strict=True):
            arcs = np.append(0.5 * width * (_NODES + 1.0), width)
            turns = (arcs[:, None] ** POWERS / POWERS) @ coefficients
            block = np.tile(start, (len(arcs), 1))
            block[:, 4 * k : 4 * k + 5] += turns
            rows.append(block[:-1])
            weights.append(0.5 * width * _WEIGHTS)
            start = block[-1]
    return HeadingBasis(np.vstack(rows), np.concatenate(weights), start)


def _newton(nlp: ConfigurationNLP, widths: FloatArray, heading: float, values: FloatArray) -> tuple[float, FloatArray]:
    """Least change of base heading and curvature, in units of the arm's length, that puts the tip on the goal."""
    task = nlp.task
    basis = heading_basis(widths)

    # A fixed base keeps its heading; behind a straight stub the curvature begins at zero.
    free = np.append(nlp.upper[2] > nlp.lower[2], np.full(len(values), fill_value=True))
    free[1] = task.stub == 0.0
    scale = np.append(1.0, np.full(len(values), 1.0 / task.length))[free]

    unknowns = np.append(heading, values)
    for _ in range(task.settings.polish_steps):
        residual, jacobian = _tip_equations(nlp, basis, unknowns)
        if np.abs(residual).max() < 1e-13 * task.length:
            break
        # The least step that solves the linearised equations, in scaled unknowns.
        step = np.linalg.lstsq(jacobian[:, free] * scale, -residual, rcond=1e-12)[0]
        unknowns[free] += scale * step
    low, high = task.base_heading_range
    return float(np.clip(unknowns[0], low, high)), unknowns[1:]


def _tip_equations(nlp: ConfigurationNLP, basis: HeadingBasis, unknowns: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Tip position [m] and, when asked for, heading minus the goal's, with their Jacobian in (θ_0, values)."""
    task = nlp.task
    theta = unknowns[0] + basis.rows @ unknowns[1:]
    cosine = np.cos(theta)
    sine = np.sin(theta)
    stub = task.stub * unit_vector(unknowns[0])
    position = stub + np.array([basis.weights @ cosine, basis.weights @ sine])
    inner = np.stack((-(basis.weights * sine) @ basis.rows, (basis.weights * cosine) @ basis.rows))
    # Turning the base turns the whole arm about it.
    turning = np.array([-position[1], position[0]])
    residual = position - (task.goal - task.base)
    jacobian = np.column_stack((turning, inner))
    if nlp.tip_heading is None:
        return residual, jacobian
    miss = unknowns[0] + basis.tip @ unknowns[1:] - nlp.tip_heading
    return np.append(residual, miss), np.vstack((jacobian, np.append(1.0, basis.tip)))


def _knots(widths: FloatArray) -> Knots:
    b, c, d = np.cumsum(widths)[:3] / widths.sum()
    return float(b), float(c), float(d)
