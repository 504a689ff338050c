"""How far a motion has come at given poses: their path parameter u, from 0 at the start to 1 at the goal."""

import numpy as np

from ccm_opt.ground.arrays import FloatArray
from ccm_opt.solution import JointPath
from ccm_opt.user_terms.check_settings import TERM_CHECKS, TermCheckSettings


def nearest_path_parameters(
    path: JointPath, poses: FloatArray, settings: TermCheckSettings = TERM_CHECKS
) -> FloatArray:
    """Where on the path given poses are nearest, never going back, shape (N,).

    Args:
        path: spline of the coordinates over u in [0, 1].
        poses: along the path, shape (N, k): the first k coordinates of the path, all or its bends alone.
        settings: fineness of the search.
    """
    width = poses.shape[1]
    places = _places(path, settings.places_per_knot)
    points = path.spline(places)[:, :width]
    sizes = np.sum(points**2, axis=1)

    u = np.empty(len(poses))
    first = 0
    for k, pose in enumerate(poses):
        # A motion may pass the same pose twice; looking forwards only, and not far, finds the right one.
        window = slice(first, first + settings.window)
        # |x − p|² without |p|², which is the same for all of them.
        first += int(np.argmin(sizes[window] - 2.0 * (points[window] @ pose)))
        u[k] = places[first]

    u = _refined(path, poses, u, settings.newton_steps)
    # The ends are known; and as Newton steps are taken for each pose alone, order is restored last.
    u[0] = 0.0
    u[-1] = 1.0
    return np.maximum.accumulate(u)


def _places(path: JointPath, per_knot: int) -> FloatArray:
    """Path parameters at equal distances between every two knots, increasing."""
    knots = np.unique(np.clip(path.spline.t, 0.0, 1.0))
    fine = np.arange(per_knot * (len(knots) - 1) + 1) / per_knot
    places: FloatArray = np.interp(fine, np.arange(len(knots)), knots)
    return places


def _refined(path: JointPath, poses: FloatArray, u: FloatArray, steps: int) -> FloatArray:
    """Newton's method (Gauss–Newton) on the squared distance of every pose to the path."""
    width = poses.shape[1]
    least_slope = 1e-12  # at a stop the path does not move, and any parameter is as good
    for _ in range(steps):
        error = poses - path.spline(u)[:, :width]
        slope = path.spline(u, 1)[:, :width]
        # Δu = (e · q') / |q'|², the error's component along the path.
        along = np.einsum("ij,ij->i", error, slope) / np.maximum(np.sum(slope**2, axis=1), least_slope)
        u = np.clip(u + along, 0.0, 1.0)
    return u
