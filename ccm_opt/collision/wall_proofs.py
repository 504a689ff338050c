"""Proofs that links stay clear of walls over stretches of a motion.

A link is clear when the hull of its four end positions, grown by the sag, meets no wall.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeAlias

import numpy as np

from ccm_opt.collision.stretches import Stretches
from ccm_opt.freespace.workspace import Workspace
from ccm_opt.ground.arrays import FloatArray, IntArray
from ccm_opt.ground.native import NativeCall

Links: TypeAlias = tuple[IntArray, IntArray]
"""Stretch and link, each of shape (k,)."""


@dataclass(frozen=True)
class WallQuestion:
    """How far links keep from walls.

    Attributes:
        workspace: the walls.
        least: distance that the axis of each link keeps, with what rounding takes, shape (links,) [m].
        mount: link on which the mount ends, and where on it in [0, 1]; what lies before may touch.
    """

    workspace: Workspace
    least: FloatArray
    mount: tuple[int, float]


@dataclass(frozen=True, eq=False)
class WallProofs:
    """What the certificate asks about links and walls.

    Attributes:
        question: walls and distances.
    """

    question: WallQuestion

    def unproved(self, stretches: Stretches, links: Links | None) -> tuple[Links, IntArray]:
        """Links that are not proved clear, and the stretches in which one of these touches a wall half-way.

        Args:
            stretches: of a motion.
            links: what is looked at; None for all links beyond the mount, stretch by stretch.
        """
        mount, share = self.question.mount
        of_arm = stretches.arm.links
        most = len(stretches.owner) * max(0, of_arm - mount) if links is None else len(links[0])
        found = np.empty((2, most), dtype=np.int64)
        touching = np.empty(most, dtype=np.bool_)
        call = NativeCall(
            "wall_proofs",
            stretches=len(stretches.owner), links=of_arm, mount_link=mount, mount_share=share,
            start=stretches.a, end=stretches.b, middle=stretches.middle, sag=stretches.sag,
            asked=-1 if links is None else len(links[0]),
            stretch=found[0], link=found[1], touching=touching,
            **self._walls, **dict(zip(("asked_stretch", "asked_link"), links or (), strict=False)),
        )  # fmt: skip
        call()
        span, link = found[:, : call.fields.count]
        return (span, link), span[touching[: call.fields.count]]

    @cached_property
    def _walls(self) -> dict[str, Any]:
        """What C knows of the walls, by its names."""
        walls = self.question.workspace.wall_segments
        return {
            "least": self.question.least,
            "segments": walls.ends,
            "rounding": walls.rounding,
            "largest_rounding": float(walls.rounding.max()),
            "tree": walls.boxes.for_c(),
            "solids": walls.solid_boxes.for_c(),
            "first_segment": np.ascontiguousarray(walls.solids[:, 0], dtype=np.int64),
            "past_segments": np.ascontiguousarray(walls.solids[:, 1], dtype=np.int64),
        }
