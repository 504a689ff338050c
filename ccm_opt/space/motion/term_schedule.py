"""When a motion should be how far, so that constraints which depend on the path parameter u are kept.

How fast u grows along a motion is free. Of all ways to let it grow, dynamic time warping (Sakoe and Chiba, 1978) takes
that which misses the constraints least, and of equal ones that which is nearest to even growth.
"""

import numpy as np

from ccm_opt.ground.arrays import FloatArray
from ccm_opt.ground.polyline import arc_lengths
from ccm_opt.space.motion.settings.schedule_settings import ScheduleSettings
from ccm_opt.space.motion.space_user_limit import SpaceUserLimit
from ccm_opt.space.motion.task import SpaceMotion


def shares_of(motion: SpaceMotion, slowness: FloatArray) -> FloatArray:
    """How far each configuration of a motion is along it, by the length of the joint path, shape (K,)."""
    arcs = arc_lengths(motion.configurations * slowness)
    return np.asarray(arcs / arcs[-1]) if arcs[-1] > 0.0 else np.linspace(0.0, 1.0, len(arcs))


def schedule(motion: SpaceMotion, user: SpaceUserLimit, slowness: FloatArray, settings: ScheduleSettings) -> FloatArray:
    """Path parameters of the configurations of a motion, increasing from 0 to 1, shape (K,).

    Args:
        motion: that knows nothing of u.
        user: the constraints.
        slowness: how dear a unit of each coordinate is, shape (c,).
        settings: how finely is looked.
    """
    share = shares_of(motion, slowness)
    s = np.linspace(0.0, 1.0, settings.places)
    q = np.column_stack([np.interp(s, share, column) for column in motion.configurations.T])
    u = np.union1d(np.linspace(0.0, 1.0, settings.steps), user.breaks)
    missed = np.stack([_missed(user, q, float(place)) for place in u], axis=1)
    price = settings.price * missed + np.abs(s[:, None] - u[None, :])
    rows, columns = _cheapest(price)
    # Where u stands still in the plan it grows a little, and so does the motion where that stands still.
    grown = (1.0 - settings.even) * u[columns] + settings.even * s[rows]
    moved = (1.0 - settings.even) * s[rows] + settings.even * u[columns]
    return np.asarray(np.interp(share, moved, grown))


def _missed(user: SpaceUserLimit, q: FloatArray, u: float) -> FloatArray:
    """By how much the worst row is missed at u, as a turn of the whole arm, in each of N configurations, shape (N,)."""
    rows = user.placed(u).rows
    table = rows.table(q, u)
    scale = user.turns(np.asarray(rows.slopes(q[0], u)[1]))
    miss = np.where(rows.equal, np.abs(table), np.maximum(-table, 0.0)) / scale
    # The table holds NaN where a row does not apply.
    return np.asarray(np.max(np.nan_to_num(miss, nan=0.0), axis=1, initial=0.0))


def _cheapest(price: FloatArray) -> tuple[list[int], list[int]]:
    """Cells of the cheapest way from the first to the last corner of a table; no step leads back."""
    total = np.full(price.shape, np.inf)
    total[0, 0] = price[0, 0]
    for i in range(price.shape[0]):
        for j in range(price.shape[1]):
            if i == j == 0:
                continue
            before = min(
                total[i - 1, j] if i else np.inf,
                total[i, j - 1] if j else np.inf,
                total[i - 1, j - 1] if i and j else np.inf,
            )
            total[i, j] = before + price[i, j]
    way = [(price.shape[0] - 1, price.shape[1] - 1)]
    while way[-1] != (0, 0):
        i, j = way[-1]
        steps = [(a, b) for a, b in ((i - 1, j - 1), (i - 1, j), (i, j - 1)) if a >= 0 and b >= 0]
        way.append(min(steps, key=lambda cell: float(total[cell])))
    way.reverse()
    return [cell[0] for cell in way], [cell[1] for cell in way]
