"""The fastest speed profile within the rows, by TOPP-RA (Pham and Pham 2018).

Its two sweeps are compiled. Where there is no compiler the toppra package makes them. Its linear programs have absolute
tolerances and fail on paths that stop and on rare crooked ones, where the path turns back; the sweeps are then made in
NumPy, in the form that is compiled, which cannot fail. toppra loads matplotlib when imported, so it is imported when
first used.
"""

import logging
import warnings
from types import SimpleNamespace
from typing import Any

import numpy as np

from ccm_opt.ground.arrays import FloatArray
from ccm_opt.retiming.path_rows import PathRows
from ccm_opt.retiming.reachability import compiled_profile, reachable_profile
from ccm_opt.retiming.timing_settings import DEFAULT_TIMING, ProfileSettings


def fastest_profile(
    rows: PathRows, slack: FloatArray, cap: FloatArray, settings: ProfileSettings = DEFAULT_TIMING.profile
) -> FloatArray:
    """Squared path speeds of the fastest motion from rest to rest.

    Args:
        rows: limits at the grid points, shape (N + 1, R).
        slack: what is left of each row's limit, shape (N + 1, R), above |c|.
        cap: bound on ṡ², shape (N + 1,) [1/s²].
        settings: of the speed profile.

    Returns:
        ṡ² at the grid points, shape (N + 1,) [1/s²]; positive inside.
    """
    capped = np.minimum(cap, settings.speed_cap / _time_unit(rows) ** 2)
    compiled = compiled_profile(rows, slack, capped, settings)
    if compiled is not None:
        return compiled
    squared = toppra_profile(rows, slack, capped)
    return reachable_profile(rows, slack, capped, settings) if squared is None else squared


def toppra_profile(rows: PathRows, slack: FloatArray, cap: FloatArray) -> FloatArray | None:
    """The same by toppra's linear programs; None where they fail."""
    unit = _time_unit(rows)
    solver = _build(rows, slack, cap * unit**2, unit)
    _, speeds, _, _ = solver.compute_parameterization(0.0, 0.0, return_data=True)
    # Two neighbouring speeds of zero would mean a stop for ever, so they count as a failure, like NaN.
    if speeds is None or np.any(np.isnan(speeds)) or np.any(speeds[1:] + speeds[:-1] <= 0.0):
        return None
    return np.asarray((speeds / unit) ** 2)


def _time_unit(rows: PathRows) -> float:
    """A time near the motion's duration, so that the solver's absolute tolerances fit any limits [s]."""
    return max(float(np.mean(rows.slowness)), float(np.sqrt(np.mean(np.max(np.abs(rows.a), axis=1)))), 1e-9)


def _build(rows: PathRows, slack: FloatArray, cap: FloatArray, unit: float) -> Any:
    """The solver on rows a s̈ + b ṡ² + c within ±1, time in units of ``unit``."""
    with warnings.catch_warnings():
        # Python warns of its texts where it has to be translated first, which is an error where warnings are.
        warnings.simplefilter("ignore", DeprecationWarning)
        warnings.simplefilter("ignore", SyntaxWarning)
        import toppra.algorithm  # noqa: PLC0415 - it is slow to import
        import toppra.constraint  # noqa: PLC0415 - likewise

    # Its failures are expected here and have a fall-back, so they are kept out of the log.
    logging.getLogger("toppra").setLevel(logging.CRITICAL)
    a = rows.a / (slack * unit**2)
    b = rows.b / (slack * unit**2)
    c = rows.c / slack
    count = a.shape[1]
    # |row| ≤ 1 as two one-sided rows: F (a s̈ + b ṡ² + c) ≤ 1 with F = (1, −1).
    both = np.concatenate((np.eye(count), -np.eye(count)))
    bound = np.stack((np.zeros(len(cap)), cap), axis=1)

    class InterpolatedRows(toppra.constraint.LinearConstraint):  # type: ignore[misc]
        """The rows, discretised by interpolation: each holds at both ends of an interval."""

        def __init__(self) -> None:
            super().__init__()
            self.identical = True
            self.set_discretization_type(toppra.constraint.DiscretizationType.Interpolation)

        def compute_constraint_params(self, _path: Any, grid: FloatArray) -> Any:
            convert = toppra.constraint.linear_constraint.canlinear_colloc_to_interpolate
            parts = convert(a, b, c, both, np.ones(2 * count), bound, None, grid, identical=True)
            # There is no bound on s̈; that on ṡ² belongs to a grid point and is not interpolated.
            return *parts[:5], None, bound

    # TOPP-RA asks the path for no more than this, since the rows are evaluated already.
    path = SimpleNamespace(path_interval=np.array([0.0, 1.0]), duration=1.0, dof=count)
    return toppra.algorithm.TOPPRA([InterpolatedRows()], path, gridpoints=rows.s, solver_wrapper="seidel")
