"""The curve that shows an arm being fed along, at all its configurations at once.

Where no joint is, the joints of one configuration say nothing of the curve. If every configuration were fitted by
itself it would swing there as the joints slide by, which the optimisation would have to take back first. So the curve
is asked to lie still from one configuration to the next beside showing the joints.
"""

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import spsolve

from ccm_opt.ground.arrays import FloatArray
from ccm_opt.space.motion.curve_map import SETTLING, CurveMap

STILL = 1e-3
"""Weight on the squares of changes of the curve's bends, beside those of the joints' turns. Measured on bent ways with
8 to 36 links: the squares of these changes are mostly less than a twentieth of those of fits of each configuration by
itself, and joints are shown as well, to 0.01 rad."""


def fitted_slide(curve: CurveMap, start: FloatArray, configurations: FloatArray) -> FloatArray:
    """Unknowns at configurations of an arm on a feed axis, shape (k, p).

    Args:
        curve: which holds the first of them exactly.
        start: unknowns there, shape (p,).
        configurations: at even steps of the feed, shape (k, c) [rad, m].
    """
    links = curve.arm.links
    shown = 2 * curve.knots
    unknowns = np.zeros((len(configurations), curve.dimension))
    unknowns[0] = start
    unknowns[1:, curve.feed_column] = configurations[1:, -1] / curve.scale[curve.feed_column]
    bends = (curve.nominal_length * curve.scale[: curve.knots]) ** 2
    ties = SETTLING * np.diff(np.eye(curve.knots), axis=0)
    blocks = []
    targets = []
    for v, q in zip(unknowns[1:], configurations[1:], strict=True):
        # About both axes knots turn the joints alike.
        rows = curve.slopes(v)[0 : 2 * links : 2, : curve.knots]
        turns = q[: 2 * links].reshape(links, 2) - curve.offsets(curve.places(float(q[-1])), v)
        blocks.append(rows.T @ rows + ties.T @ ties)
        targets.append(rows.T @ turns)
    targets[0] = targets[0] + STILL * bends[:, None] * start[:shown].reshape(2, curve.knots).T
    count = len(blocks)
    changes = np.eye(count) - np.eye(count, k=-1)
    still = STILL * sp.kron(changes.T @ changes, np.diag(bends))
    found = np.asarray(spsolve(sp.csc_array(sp.block_diag(blocks) + still), np.vstack(targets)))
    unknowns[1:, :shown] = found.reshape(count, curve.knots, 2).transpose(0, 2, 1).reshape(count, shown)
    return unknowns
