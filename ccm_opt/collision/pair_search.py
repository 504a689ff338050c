"""Near pairs of an arm and walls, found by compiled C."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from ccm_opt.collision.collision_settings import ContactSettings
from ccm_opt.collision.contacts import Contacts
from ccm_opt.freespace.walls import Walls
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.ground.native import NativeCall
from ccm_opt.jointed.arm import Arm

_RUN = 8
"""``RUN`` of near_pairs.c."""


@dataclass(frozen=True)
class PairQuestion:
    """One arm among fixed walls, and which of its near pairs are wanted.

    Attributes:
        arm: the arm.
        walls: the walls.
        clearance: gap to keep to walls beyond the radius [m].
        margin: planning margin on top of it [m].
        reach: pairs with a gap below this are reported [m].
        settings: of the neighbour list and of margins between links.
    """

    arm: Arm
    walls: Walls
    clearance: float
    margin: float
    reach: float
    settings: ContactSettings

    @cached_property
    def wall_gap(self) -> FloatArray:
        """Distance of the arm's axis from each wall's core where they touch, shape (walls,) [m]."""
        return self.arm.radius + self.clearance + self.walls.rounding

    @cached_property
    def error_room(self) -> FloatArray:
        """Room for errors between each link and a wall, which all joints up to the link move, shape (links,) [m]."""
        return self.arm.room_for_errors(np.arange(1, self.arm.links + 1))

    @cached_property
    def pair_room(self) -> FloatArray:
        """The same between two links, moved by the joints between them, by their distance j − i, shape (links,) [m]."""
        return self.arm.room_for_errors(np.arange(self.arm.links))

    @cached_property
    def pair_margin(self) -> FloatArray:
        """Margin between two links by their distance j − i, shape (links,) [m]."""
        apart = np.arange(self.arm.links)
        return self.arm.link_margins(np.zeros_like(apart), apart, self.margin, self.settings.link_margins)


class PairSearch:
    """Finds near pairs; not for use by two threads at once.

    Args:
        question: arm, walls, and which pairs are wanted.
    """

    def __init__(self, question: PairQuestion) -> None:
        arm = question.arm
        walls = question.walls
        link, at = arm.mount_end
        self._points = np.empty((arm.links + 1, 2))
        self._call = NativeCall(
            "near_pairs",
            links=arm.links, mount_link=link, mount_at=at, link_length=arm.link_length, radius=arm.radius,
            first_self_pair=arm.first_self_pair if arm.self_collision else arm.links,
            reach=question.reach, margin=question.margin,
            error_room=question.error_room, pair_room=question.pair_room, pair_margin=question.pair_margin,
            edge_tree=walls.edge_tree.for_c(), vertex_tree=walls.vertex_tree.for_c(),
            edges=walls.edges, vertices=walls.vertices, edge_wall=walls.edge_wall, vertex_wall=walls.vertex_wall,
            walls=len(walls.names), wall_gap=question.wall_gap, largest_gap=float(question.wall_gap.max()),
            found=np.zeros(max(len(walls.edges), len(walls.vertices)), dtype=np.int64),
            runs=np.zeros(4 * (arm.links // _RUN + 1)),
            points=self._points,
        )  # fmt: skip
        self._latest: FloatArray | None = None
        self._make_room(64)

    def contacts(self, points: FloatArray) -> Contacts:
        """All pairs of a pose with a gap below the reach; ``points`` has the shape (links + 1, 2) [m]."""
        self._ask(points)
        m = self._call.fields.count
        results = {name: array[:m].copy() for name, array in self._results.items()}
        return Contacts(
            results["first"], results["first_at"], results["second"], results["second_at"], results["normal"],
            results["gap"], results["pair_margins"], results["wall"],
        )  # fmt: skip

    def crosses(self, points: FloatArray) -> bool:
        """Whether any link of a pose cuts an edge of a wall or a distant link."""
        if self._latest is not points:
            self._ask(points)
        return bool(self._call.fields.crosses)

    def _ask(self, points: FloatArray) -> None:
        self._points[:] = points
        self._call()
        if self._call.fields.count > self._call.fields.capacity:
            self._make_room(2 * self._call.fields.count)
            self._call()
        # By identity: whether a pose crosses anything is asked right after its contacts.
        self._latest = points

    def _make_room(self, capacity: int) -> None:
        """Room for so many results."""
        whole = np.empty((3, capacity), dtype=np.int64)
        real = np.empty((4, capacity))
        self._results: dict[str, npt.NDArray[Any]] = {
            **dict(zip(("first", "second", "wall"), whole, strict=True)),
            **dict(zip(("first_at", "second_at", "gap", "pair_margins"), real, strict=True)),
            "normal": np.empty((capacity, 2)),
        }
        self._call.set(capacity=capacity, **self._results)
