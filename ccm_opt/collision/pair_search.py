"""What a search for near pairs is asked, and what it answers."""

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np

from ccm_opt.collision.collision_settings import ContactSettings
from ccm_opt.collision.contacts import Contacts
from ccm_opt.freespace.walls import Walls
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.jointed.arm import Arm


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


class PairSearch(Protocol):
    """Finds near pairs; not for use by two threads at once."""

    def contacts(self, points: FloatArray) -> Contacts:
        """All pairs of a pose, joints and tip of shape (links + 1, 2) [m], with a gap below the reach."""
        ...

    def crosses(self, points: FloatArray) -> bool:
        """Whether any link of a pose cuts an edge of a wall or a distant link."""
        ...
