"""Proofs that pairs of links stay apart over stretches of a motion.

A pair is apart when all eight corner differences keep their distance along the direction that is closest half-way; only
the links between the two add to the sag of their difference.
"""

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from ccm_opt.collision.stretches import Stretches
from ccm_opt.ground.arrays import BoolArray, FloatArray, IntArray
from ccm_opt.ground.native import NativeCall

Pairs: TypeAlias = tuple[IntArray, IntArray, IntArray]
"""Stretch, link, and a later link, each of shape (k,)."""


@dataclass(frozen=True, eq=False)
class PairProofs:
    """What the certificate asks about pairs of links.

    Attributes:
        first_apart: least difference of the numbers of two links that count.
        least: distance that the axes of two links keep, by the difference of their numbers, shape (links,) [m].
    """

    first_apart: int
    least: FloatArray

    def unproved(self, stretches: Stretches, pairs: Pairs | None) -> tuple[Pairs, IntArray]:
        """Pairs that are not proved apart, and the stretches in which one of these touches half-way.

        Args:
            stretches: of a motion.
            pairs: what is looked at; None for all distant links that come anywhere near each other.
        """
        arm = stretches.arm
        call = NativeCall(
            "pair_proofs",
            stretches=len(stretches.owner), links=arm.links, first_apart=self.first_apart, link_length=arm.link_length,
            least=self.least, start=stretches.a, end=stretches.b, middle=stretches.middle, sag=stretches.sag,
            moved=stretches.moved, asked=-1 if pairs is None else len(pairs[0]),
            **dict(zip(("asked_stretch", "asked_first", "asked_second"), pairs or (), strict=False)),
        )  # fmt: skip
        capacity = 1024 if pairs is None else len(pairs[0])
        found, touching = _called(call, capacity)
        if call.fields.count > capacity:
            found, touching = _called(call, call.fields.count)
        span, i, j = found[:, : call.fields.count]
        return (span, i, j), span[touching[: call.fields.count]]


def _called(call: NativeCall, capacity: int) -> tuple[IntArray, BoolArray]:
    """Stretch and links of what is found, shape (3, capacity), and which of it touches, shape (capacity,)."""
    found = np.empty((3, capacity), dtype=np.int64)
    touching = np.empty(capacity, dtype=np.bool_)
    call.set(capacity=capacity, stretch=found[0], first=found[1], second=found[2], touching=touching)
    call()
    return found, touching
