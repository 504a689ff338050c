"""The search of followable_search.py by compiled C."""

import ctypes
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ccm_opt.ground.arrays import FloatArray
from ccm_opt.ground.compiled_source import compiled_source, pointer_to
from ccm_opt.space.motion.followable_search import FollowSearch, WayEnd

_BINS = 7
_STATE = np.dtype(
    [
        ("place", np.float64, 3),
        ("frame", np.float64, 9),
        ("cost", np.float64),
        ("length", np.float64),
        ("before", np.int64),
        ("arc", np.int64),
    ]
)
"""``State`` of followable_search.c."""


class _FollowStruct(ctypes.Structure):
    """``FollowQuery`` of followable_search.c."""

    _fields_ = (
        *((name, ctypes.c_int64) for name in ("nx", "ny", "nz", "choices", "samples", "directed")),
        *((name, ctypes.c_int64) for name in ("most_states", "direction_bins", "table")),
        *((name, ctypes.c_double) for name in ("cell", "step", "most", "place_bin", "landing", "longest")),
        *((name, ctypes.c_double) for name in ("radius", "spacing")),
        *((name, ctypes.c_double * 3) for name in ("low", "goal", "direction")),
        *((name, ctypes.c_void_p) for name in ("price", "left", "arcs", "turns", "dear")),
        *((name, ctypes.c_void_p) for name in ("states", "heap", "key", "bins", "taken")),
        ("found", ctypes.c_int64),
    )


def searched_in_c() -> ctypes.PyDLL | None:
    """The compiled library; None where there is no compiling."""
    return compiled_source(Path(__file__).with_name("followable_search.c"), ("followable_way",))


def compiled_arcs(
    library: ctypes.PyDLL, search: FollowSearch, goal: WayEnd, place: FloatArray, frame: FloatArray
) -> list[int] | None:
    """As ``InterpretedSearch.arcs_from``, of which it takes the place; without a deadline, for it takes milliseconds.

    Args:
        library: from ``searched_in_c``.
        search: what is searched.
        goal: where ways end.
        place: where they begin, shape (3,) [m].
        frame: (t, n1, n2) there as columns, shape (3, 3).
    """
    query = _query(search, goal)
    capacity = query.most_states * query.choices + 1
    # Memory that is not written to is not taken either.
    arrays: dict[str, npt.NDArray[Any]] = {
        "price": np.ascontiguousarray(search.price, dtype=np.float32),
        "left": np.ascontiguousarray(search.left, dtype=np.float64),
        "arcs": np.ascontiguousarray(search.arcs.places),
        "turns": np.ascontiguousarray(search.arcs.turns),
        "dear": np.ascontiguousarray(search.arcs.dear),
        "states": np.empty(capacity, dtype=_STATE),
        "heap": np.empty(capacity, dtype=np.int64),
        "key": np.empty(capacity),
        "bins": np.empty((query.table, _BINS), dtype=np.int32),
        "taken": np.zeros(query.table, dtype=np.uint8),
    }
    for name, array in arrays.items():
        setattr(query, name, array.ctypes.data)
    states = arrays["states"]
    states[0] = (place, frame.ravel(), 0.0, 0.0, -1, -1)
    library.followable_way(pointer_to(query))
    return None if query.found < 0 else _arcs_to(query.found, states["before"], states["arc"])


def _query(search: FollowSearch, goal: WayEnd) -> _FollowStruct:
    """All but the arrays."""
    settings = search.settings
    choices, samples, _ = search.arcs.places.shape
    table = 1 << (2 * settings.most_states).bit_length()
    query = _FollowStruct(choices=choices, samples=samples, most_states=settings.most_states, table=table)
    query.nx, query.ny, query.nz = search.price.shape
    query.direction_bins = settings.direction_bins
    query.cell = search.cell
    query.step = search.arcs.length
    query.most = search.most
    query.place_bin = settings.place_bin * search.unit
    query.landing = settings.landing * search.unit
    query.longest = settings.longest_landing
    query.radius = search.radius
    query.spacing = 0.5 * search.cell
    query.low[:] = search.low.tolist()
    query.goal[:] = goal.place.tolist()
    if goal.direction is not None:
        query.directed = 1
        query.direction[:] = goal.direction.tolist()
    return query


def _arcs_to(state: int, before: npt.NDArray[np.int64], arc: npt.NDArray[np.int64]) -> list[int]:
    """Numbers of the arcs from the first state to another one."""
    found = []
    while before[state] >= 0:
        found.append(int(arc[state]))
        state = int(before[state])
    return found[::-1]
