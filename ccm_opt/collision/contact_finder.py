"""The finder of contacts: asks a search for near pairs, and tells of them in words."""

import numpy as np

from ccm_opt.collision.collision_settings import DEFAULT_CONTACTS, ContactSettings
from ccm_opt.collision.contacts import WALL, Contacts
from ccm_opt.collision.pair_search import PairQuestion, PairSearch
from ccm_opt.freespace.walls import Walls
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.ground.length_words import short_length
from ccm_opt.jointed.arm import Arm


class ContactFinder:
    """Finds the contacts of poses of one arm among fixed walls.

    Args:
        arm: the arm.
        walls: the walls.
        clearance: gap to keep to walls beyond the radius [m].
        margin: planning margin m on top of it [m].
        reach: pairs with a gap below this are reported [m].
        settings: of the neighbour list and of margins between links.
    """

    def __init__(
        self,
        arm: Arm,
        walls: Walls,
        clearance: float,
        margin: float,
        reach: float,
        settings: ContactSettings = DEFAULT_CONTACTS,
    ) -> None:
        self.arm = arm
        self.walls = walls
        self.margin = margin
        self.reach = reach
        self.settings = settings
        self._search = PairSearch(PairQuestion(arm, walls, clearance, margin, reach, settings))
        self._latest: tuple[FloatArray, Contacts] | None = None

    def find(self, points: FloatArray) -> Contacts:
        """Contacts of a pose with a gap below the reach.

        Args:
            points: joint and tip positions, shape (links + 1, 2) [m].
        """
        # By identity, not by value: a step and its check ask for the same array twice. Arrays of points must not be
        # changed in place.
        if self._latest is not None and self._latest[0] is points:
            return self._latest[1]
        contacts = self._search.contacts(points)
        self._latest = (points, contacts)
        return contacts

    def describe(self, contacts: Contacts) -> str:
        """The contact that is furthest inside its margin, in words."""
        tightest = self.tightest(contacts)
        if tightest is None:
            return "nothing near"
        link, other, gap = tightest
        return f"link {link} and {other}, gap {short_length(gap)}"

    def tightest(self, contacts: Contacts) -> tuple[int, str, float] | None:
        """Of the contact that is furthest inside its margin: link from 1, what it is near to, gap [m]; None if none."""
        if len(contacts) == 0:
            return None
        k = int(np.argmin(contacts.gap - contacts.margin))
        wall = contacts.second[k] == WALL
        other = f"'{self.walls.names[contacts.wall[k]]}'" if wall else f"link {contacts.second[k] + 1}"
        return int(contacts.first[k]) + 1, other, float(contacts.gap[k])

    def crosses(self, points: FloatArray) -> bool:
        """Whether any link cuts an edge of a wall or a distant link."""
        return self._search.crosses(points)
