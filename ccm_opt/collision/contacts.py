"""Contacts: near pairs of the arm with walls and with itself, with gap, direction, and where on which link."""

from dataclasses import dataclass

import numpy as np

from ccm_opt.ground.arrays import BoolArray, FloatArray, IntArray

WALL = -1
"""Stands for the second link of a contact with a wall."""


@dataclass(frozen=True)
class Contacts:
    """Near pairs of one pose.

    Attributes:
        first: link of the point that ``normal`` pushes away, shape (m,).
        first_at: its place on the link in [0, 1], shape (m,).
        second: the other link, or ``WALL``, shape (m,).
        second_at: place on the other link, shape (m,).
        normal: unit direction from the other body to the first point, shape (m, 2).
        gap: distance between the surfaces beyond the clearance asked for, shape (m,) [m].
        margin: gap to keep while planning, shape (m,) [m].
        wall: index of the wall, or the number of walls for self-contacts, shape (m,).
    """

    first: IntArray
    first_at: FloatArray
    second: IntArray
    second_at: FloatArray
    normal: FloatArray
    gap: FloatArray
    margin: FloatArray
    wall: IntArray

    def __len__(self) -> int:
        return len(self.gap)

    def take(self, mask: BoolArray) -> "Contacts":
        """The contacts selected by a mask."""
        return Contacts(*(getattr(self, name)[mask] for name in self.__dataclass_fields__))

    def shortfall(self) -> float:
        """Largest excess of the planning margin over the gap [m]; negative when every margin is kept."""
        return float(np.max(self.margin - self.gap, initial=-np.inf))


def joined_contacts(parts: list[Contacts]) -> Contacts:
    """All contacts of several lists."""
    return Contacts(*(np.concatenate([getattr(p, name) for p in parts]) for name in Contacts.__dataclass_fields__))
