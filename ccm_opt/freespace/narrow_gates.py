"""Gates that hardly let the arm through: paths lead through them straight, with a straight run before and behind.

A link is stiff. Where it has next to no play it passes only if it lies square to the gate, and so must the link that
follows it; a taut string, which bends in the very gate, leads it in askew.
"""

import itertools
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ccm_opt.ground.arrays import BoolArray, FloatArray

Tautening = Callable[[FloatArray], FloatArray]
"""Draws a polyline (m, 2) [m] taut."""
Membership = Callable[[FloatArray], BoolArray]
"""Tells which places (m, 2) [m] are free."""


@dataclass(frozen=True)
class GateRuns:
    """Which gates are narrow, and how far paths run straight on either side of them.

    Attributes:
        narrow: width of free space below which a passage is such a gate [m].
        run: length of the straight runs, where they are free [m].
        base: of the arm, round which space is narrow for no link, shape (2,) [m].
        about_base: distance from the base within which that holds [m].
        samples: places of a run that have to be free.
        shortenings: shares of the run that are tried.
    """

    narrow: float
    run: float
    base: FloatArray
    about_base: float
    samples: int = 9
    shortenings: tuple[float, ...] = (1.0, 0.7, 0.4)

    def gates(self, portals: FloatArray) -> list[tuple[int, int]]:
        """First and last portal, shape (n, 2, 2) [m], of each narrow gate."""
        if len(portals) == 0:
            return []
        widths = np.linalg.norm(portals[:, 0] - portals[:, 1], axis=1)
        beside_base = np.linalg.norm(portals - self.base, axis=2).min(axis=1) < self.about_base
        narrow = np.flatnonzero((widths < self.narrow) & ~beside_base)
        # Between the two ends of a thick gate a path crosses its diagonal.
        groups = np.split(narrow, np.flatnonzero(np.diff(narrow) > 2) + 1)
        return [(int(group[0]), int(group[-1])) for group in groups if len(group)]

    def places(self, portals: FloatArray) -> FloatArray:
        """Places along the middles of all narrow gates, shape (m, 2) [m]; portals of shape (n, 2, 2) [m]."""
        ways = [portals[first : last + 1].mean(axis=1) for first, last in self.gates(portals)]
        share = np.linspace(0.0, 1.0, self.samples)[:, None]
        legs = [(1.0 - share) * a + share * b for way in ways for a, b in itertools.pairwise(way)]
        return np.vstack([np.zeros((0, 2)), *ways, *legs])


@dataclass(frozen=True)
class _Gate:
    """One gate on a path.

    Attributes:
        first: number of the first portal.
        last: number of the last.
        before: where the straight run towards it begins, shape (2,) [m].
        behind: where the straight run out of it ends, shape (2,) [m].
    """

    first: int
    last: int
    before: FloatArray
    behind: FloatArray


def straight_through_gates(
    path: FloatArray, portals: FloatArray, runs: GateRuns, taut: Tautening, free: Membership
) -> FloatArray:
    """A taut path with straight runs through the narrow gates that it crosses; the same path where it crosses none.

    Args:
        path: shape (k, 2) [m].
        portals: that it crosses, shape (n, 2, 2) [m].
        runs: which gates are narrow.
        taut: draws what is between the gates.
        free: places that runs may pass.
    """
    gates = _gates(path, portals, runs, free)
    if not gates:
        return path
    middles = portals.mean(axis=1)
    pieces = []
    here = path[:1]
    crossed = 0
    for gate in gates:
        # From portal to portal the polyline stays within triangles, so that its class is that of the path.
        pieces.append(taut(np.vstack((here, middles[crossed : gate.first + 1], gate.before))))
        pieces.append(middles[gate.first : gate.last + 1])
        here = gate.behind[None]
        crossed = gate.last
    pieces.append(taut(np.vstack((here, middles[crossed:], path[-1:]))))
    return np.vstack(pieces)


def gate_rails(path: FloatArray, portals: FloatArray, runs: GateRuns, free: Membership) -> tuple[FloatArray, ...]:
    """The middle lines of the gates on a path with their runs, each of shape (k, 2) [m]; arguments as above."""
    middles = portals.mean(axis=1)
    gates = _gates(path, portals, runs, free)
    return tuple(np.vstack((gate.before, middles[gate.first : gate.last + 1], gate.behind)) for gate in gates)


def _gates(path: FloatArray, portals: FloatArray, runs: GateRuns, free: Membership) -> list[_Gate]:
    """The gates of a path with their runs, each at most half of the way to the next."""
    groups = runs.gates(portals)
    if not groups:
        return []
    middles = portals.mean(axis=1)
    entries = np.vstack([middles[first] for first, _ in groups] + [path[-1]])
    exits = np.vstack([path[0]] + [middles[last] for _, last in groups])
    between = np.linalg.norm(entries - exits, axis=1)
    # The path's ends have no run of their own.
    share = np.where(np.isin(np.arange(len(between)), (0, len(between) - 1)), 0.9, 0.45)
    lengths = np.minimum(runs.run, share * between)
    gates = []
    for k, (first, last) in enumerate(groups):
        inwards = _direction(portals[first : last + 1])
        outwards = -_direction(portals[first : last + 1][::-1, ::-1])
        before = _run(middles[first], -lengths[k] * inwards, runs, free)
        behind = _run(middles[last], lengths[k + 1] * outwards, runs, free)
        gates.append(_Gate(first, last, before, behind))
    return gates


def _direction(portals: FloatArray) -> FloatArray:
    """In which direction a gate is entered at its first portal, shape (2,): on to the next, or square to it."""
    middles = portals.mean(axis=1)
    width = float(np.linalg.norm(portals[0, 0] - portals[0, 1]))
    onward = middles - middles[0]
    distance = np.linalg.norm(onward, axis=1)
    far = np.flatnonzero(distance > width)
    if len(far):
        return np.asarray(onward[far[0]] / distance[far[0]])
    narrowest = portals[int(np.argmin(np.linalg.norm(portals[:, 0] - portals[:, 1], axis=1)))]
    across = narrowest[0] - narrowest[1]
    return np.asarray(np.array([across[1], -across[0]]) / np.hypot(*across))


def _run(place: FloatArray, run: FloatArray, runs: GateRuns, free: Membership) -> FloatArray:
    """The end of the longest free run from a place, the place itself where none is free, shape (2,) [m]."""
    for share in runs.shortenings:
        end = place + share * run
        if free(np.linspace(place, end, runs.samples)).all():
            return end
    return place
