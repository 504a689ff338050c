"""An oracle for arms of sections that bend evenly: the arm of a problem file as a chain of short chords of true arcs.

A section of the length L that turns by the rotation vector φ is at the fraction s of its length turned by s φ, and is
there at L ∫ exp(s φ) x ds. Its body is taken as thick as at the thinner end of each chord, less the distance of the
chord from its arc, so that what touches here touches.
"""

from functools import cached_property
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from ccm_opt.core.arrays import FloatArray
from tests.benchmarks.swept_file import FileArm

PIECES = 32
"""Number of chords of each section."""


class ArcArm(FileArm):
    """The arm of a problem file whose sections bend evenly; its links are chords, and its joints the sections."""

    @property
    def joints(self) -> int:
        """Number of the sections."""
        return len(self.sections)

    @property
    def joint_places(self) -> FloatArray:
        """Arc lengths of the beginnings of the sections, shape (s,) [m]."""
        return np.asarray(self.places[:-1:PIECES])

    @cached_property
    def lengths(self) -> FloatArray:
        """Length of the arc of each chord, shape (pieces,) [m]."""
        return np.repeat([row["length"] / PIECES for row in self.sections], PIECES)

    @cached_property
    def radii(self) -> FloatArray:
        """Radius of each chord, shape (pieces,) [m]."""
        found = []
        for row, limit in zip(self.sections, self.limits[:, 0], strict=True):
            first, last = np.broadcast_to(row["radius"], 2)
            ends = np.linspace(first, last, PIECES + 1)
            beside = np.sqrt(2.0) * limit / PIECES * row["length"] / PIECES / 8.0
            found.append(np.minimum(ends[:-1], ends[1:]) - beside)
        return np.concatenate(found)

    @cached_property
    def limits(self) -> FloatArray:
        """Limits of the bends of the sections, shape (s, 2) [rad]."""
        return np.deg2rad([2 * [row["bend_limit_deg"]] for row in self.sections])

    @cached_property
    def mounted(self) -> FloatArray:
        """Share of each chord that belongs to the mount, with some allowance for links beside arcs, (pieces,)."""
        moves = self.space and "axes" in self.table["base"]
        mount = 0.0 if moves else self.table.get("mount_length", 1.2 * np.max(self.sections[0]["radius"]))
        return np.asarray(np.clip((mount - self.places[:-1]) / self.lengths + 1e-9, 0.0, 1.0))

    @cached_property
    def pairs(self) -> list[tuple[int, int]]:
        """Pairs of chords with four links, half a turn of the thickest and more between them."""
        links = max(row["length"] / row["links"] for row in self.sections)
        apart = 4.0 * links + 1.2 * np.pi * max(np.max(row["radius"]) for row in self.sections)
        count = len(self.lengths)
        return [
            (i, j) for i in range(count) for j in range(i + 1, count) if self.places[j] - self.places[i + 1] >= apart
        ]

    def placed(self, bends: FloatArray, axes: FloatArray) -> tuple[FloatArray, Any]:
        """Return the ends of chords, (T, pieces + 1, d) [m], and frames (pieces) or headings (T, pieces) there.

        Args:
            bends: bends of the sections, shape (T, s) or (T, s, 2) [rad].
            axes: positions of the axes below the arm, shape (T, k) [m, rad].
        """
        if not self.space:
            place, turn = self.base
            each = np.repeat(bends / PIECES, PIECES, axis=1)
            headings = turn + np.cumsum(each, axis=1)
            chords = self.lengths * np.sinc(0.5 * each / np.pi)
            middles = headings - 0.5 * each
            steps = chords[..., None] * np.stack((np.cos(middles), np.sin(middles)), axis=-1)
            feed = axes.sum(axis=1)[:, None] * np.array([np.cos(turn), np.sin(turn)])
            steps = np.concatenate((np.zeros((len(bends), 1, 2)), np.cumsum(steps, axis=1)), axis=1)
            return place + feed[:, None] + steps, headings
        origin, frames = self._carried(axes)
        points = np.empty((len(bends), len(self.lengths) + 1, 3))
        points[:, 0] = origin
        found = []
        for k, length in enumerate(self.lengths.tolist()):
            a, b = bends[:, k // PIECES].T / PIECES
            turn = np.column_stack((np.zeros_like(a), b, a))
            half = frames * Rotation.from_rotvec(0.5 * turn)
            chord = length * np.sinc(0.5 * np.linalg.norm(turn, axis=1) / np.pi)
            points[:, k + 1] = points[:, k] + chord[:, None] * half.apply([1.0, 0.0, 0.0])
            frames = frames * Rotation.from_rotvec(turn)
            found.append(frames)
        return points, found
