"""The curvature operators (section 2.1): move an interpolation point up or down, left or right; rotate the base."""

from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from ccm_opt.baseline.candidate_moves import Shapes
from ccm_opt.core.arrays import FloatArray


class Operator(StrEnum):
    """What an operator moves; each works both ways."""

    C_A = "C_a"
    C_B = "C_b"
    C_C = "C_c"
    C_D = "C_d"
    C_E = "C_e"
    S_B = "S_b"
    S_C = "S_c"
    S_D = "S_d"
    ROTATE = "rotate"
    LENGTH = "length"


UP_AND_DOWN = (Operator.C_A, Operator.C_B, Operator.C_C, Operator.C_D, Operator.C_E)
LEFT_AND_RIGHT = (Operator.S_B, Operator.S_C, Operator.S_D)
ALL = (*UP_AND_DOWN, *LEFT_AND_RIGHT, Operator.ROTATE)
"""The paper's nine. ``LENGTH`` is no operator of the arm, which keeps its length: SCM-4 uses it to choose one."""


@dataclass(frozen=True)
class StepSizes:
    """How far operators move at most, and the finer steps tried beside that.

    The step adapts in each move: all scales are evaluated in one batch, and the search takes which is best. The paper
    is silent about step sizes; these are this package's choice.

    Attributes:
        least_spacing: least distance of interpolation points, and of the outer ones from the ends, as a share of the
            segment. Points that are nearer already, as in a part of a divided segment, may keep their distance.
        turn: change of C times the segment's length [rad].
        slide: change of S.
        rotation: turn of the base [rad].
        stretch: change of length, as a share of it.
        scales: factors on all of these, decreasing.
    """

    least_spacing: float = 0.08
    turn: float = 0.6
    slide: float = 0.04
    rotation: float = 0.15
    stretch: float = 0.05
    scales: tuple[float, ...] = (1.0, 0.3, 0.1, 0.03, 0.01, 0.003, 0.001)


@dataclass(frozen=True)
class Moves:
    """Which operators apply to which segments.

    Attributes:
        segments: their indices; the base rotates whichever they are.
        operators: in the order in which first improvement tries them.
        sizes: of the steps.
    """

    segments: tuple[int, ...] = (0,)
    operators: tuple[Operator, ...] = ALL
    sizes: StepSizes = StepSizes()

    def candidates(self, here: Shapes) -> Shapes:
        """Every operator both ways at every scale, from a batch of one; invalid ones left out."""
        scales = np.asarray(self.sizes.scales)
        signed = np.stack((scales, -scales), axis=1).ravel()
        pairs: list[tuple[Operator, int]] = [
            (o, k) for k in self.segments for o in self.operators if o is not Operator.ROTATE
        ]
        if Operator.ROTATE in self.operators:
            pairs.append((Operator.ROTATE, 0))  # the base has no segment
        many = here.take(np.zeros(len(pairs) * len(signed), dtype=np.intp))
        least = min(self.sizes.least_spacing, float(_spacing(many.knots[-1:, self.segments])[0])) * (1.0 - 1e-9)
        # Block k of the batch is for pair k: all its scales, both ways.
        for k, (operator, segment) in enumerate(pairs):
            _apply(many, slice(k * len(signed), (k + 1) * len(signed)), operator, segment, signed, self.sizes)
        return many.take(np.flatnonzero(_spacing(many.knots[:, self.segments]) >= least))


def _apply(many: Shapes, rows: slice, operator: Operator, segment: int, signed: FloatArray, sizes: StepSizes) -> None:
    """Move some rows of a fresh batch by one operator."""
    if operator in UP_AND_DOWN:
        lengths = many.lengths[rows, segment]
        many.curvature[rows, segment, UP_AND_DOWN.index(operator)] += signed * sizes.turn / lengths
    elif operator in LEFT_AND_RIGHT:
        many.knots[rows, segment, LEFT_AND_RIGHT.index(operator)] += signed * sizes.slide
    elif operator is Operator.ROTATE:
        many.heading[rows] += signed * sizes.rotation
    else:
        many.lengths[rows, segment] *= 1.0 + signed * sizes.stretch


def _spacing(knots: FloatArray) -> FloatArray:
    """Least gap of S_b, S_c, S_d among themselves and to 0 and 1, shape (m, segments, 3) to (m,)."""
    edge = np.zeros((*knots.shape[:2], 1))
    gaps = np.diff(np.concatenate((edge, knots, edge + 1.0), axis=2), axis=2)
    least: FloatArray = gaps.min(axis=(1, 2))
    return least
