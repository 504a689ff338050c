"""The fastest speed profile within the rows, by the toppra package (TOPP-RA, Pham and Pham 2018).

Its linear programs have absolute tolerances and fail on paths that stop and on rare crooked ones, where the path turns
back. There, and where toppra is not installed, the sweeps of ``reachability`` find the speeds; the profile says which.
toppra loads matplotlib when imported, so it is imported when first used.
"""

import logging
import warnings
from types import SimpleNamespace
from typing import Any

import numpy as np

from ccm_opt.errors import Diagnosis, RetimingError
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.retiming.path_rows import PathRows
from ccm_opt.retiming.profile import SpeedProfile
from ccm_opt.retiming.reachability import reachable_speeds
from ccm_opt.retiming.timing_settings import DEFAULT_TIMING, ProfileSettings


def fastest_profile(
    rows: PathRows, slack: FloatArray, cap: FloatArray, settings: ProfileSettings = DEFAULT_TIMING.profile
) -> SpeedProfile:
    """Find the fastest motion from rest to rest.

    Args:
        rows: limits at the grid points, shape (N + 1, R).
        slack: what is left of each row's limit, shape (N + 1, R), above |c|.
        cap: bound on ṡ², shape (N + 1,) [1/s²].
        settings: of the speed profile.

    Returns:
        The profile, its speeds positive inside; ``timed_by`` says what found them.
    """
    capped = np.minimum(cap, settings.speed_cap / _time_unit(rows) ** 2)
    try:
        return SpeedProfile(rows.s, toppra_speeds(rows, slack, capped), "toppra")
    except RetimingError as failure:
        squared = reachable_speeds(rows, slack, capped, settings)
        return SpeedProfile(rows.s, squared, f"sweeps: {failure.diagnosis.reason}")


def toppra_speeds(rows: PathRows, slack: FloatArray, cap: FloatArray) -> FloatArray:
    """Find ṡ² at the grid points by toppra's linear programs, shape (N + 1,) [1/s²].

    Raises:
        RetimingError: they fail, or toppra is not there.
    """
    unit = _time_unit(rows)
    solver = _solver(rows, slack, cap * unit**2, unit)
    _, speeds, _, controllable = solver.compute_parameterization(0.0, 0.0, return_data=True)
    if speeds is None:
        # toppra sweeps from the end and leaves off at the first point from which it finds no way on.
        raise _failed(rows, int(np.flatnonzero(np.isnan(controllable).any(axis=1))[-1]))
    # Two neighbouring speeds of zero would mean a stop for ever.
    bad = np.isnan(speeds[1:]) | (speeds[1:] + speeds[:-1] <= 0.0)
    if np.any(bad):
        raise _failed(rows, int(np.argmax(bad)))
    return np.asarray((speeds / unit) ** 2)


def _failed(rows: PathRows, point: int) -> RetimingError:
    gain = np.max(np.abs(rows.a), axis=1)
    # Measured on random paths: where toppra fails beside a stop or a turning point it is 1e-4 of the greatest at most.
    slow = ", where it all but stops" if gain[point] < 1e-3 * np.max(gain) else ""
    return RetimingError(Diagnosis(f"toppra fails at {rows.s[point]:.1%} of the path{slow}", "retiming"))


def _time_unit(rows: PathRows) -> float:
    """A time near the motion's duration, so that the solver's absolute tolerances fit any limits [s]."""
    return max(float(np.mean(rows.slowness)), float(np.sqrt(np.mean(np.max(np.abs(rows.a), axis=1)))), 1e-9)


def _solver(rows: PathRows, slack: FloatArray, cap: FloatArray, unit: float) -> Any:
    """Build toppra's solver on rows a s̈ + b ṡ² + c within ±slack, time in units of ``unit``."""
    try:
        with warnings.catch_warnings():
            # Python warns of its texts where it has to be translated first, which is an error where warnings are.
            warnings.simplefilter("ignore", DeprecationWarning)
            warnings.simplefilter("ignore", SyntaxWarning)
            import toppra.algorithm  # noqa: PLC0415 - it is slow to import
            import toppra.constraint  # noqa: PLC0415 - likewise
    except (ImportError, ValueError) as error:  # it has wheels for Linux alone; matplotlib refuses a strange MPLBACKEND
        raise RetimingError(Diagnosis(f"toppra cannot be loaded ({error})", "retiming")) from error

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
