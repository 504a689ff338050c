"""Ways of the tip to the goal from wherever the arm lies: back along the arm and over, or by way of a random place.

Routes from the base, shortest first, seldom lead along the arm as it lies, for among many walls there are hundreds
that are hardly longer than the shortest. But the arm keeps to the class that it lies in, and what its tip draws back
bows out between the walls.
"""

from dataclasses import dataclass

import numpy as np

from ccm_opt.errors import UnreachableGoal
from ccm_opt.freespace.free_space import FreeSpace
from ccm_opt.ground.angles import unit_vector
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.jointed.arm import Arm
from ccm_opt.motion.goal import GoalPose
from ccm_opt.motion.link_space import NOMINAL_LINKS
from ccm_opt.motion.pose import Pose
from ccm_opt.motion.settings.tip_walk_settings import TipWalkSettings


@dataclass(frozen=True)
class TipWays:
    """Draws taut paths of the tip; every one ends with a straight run onto the goal along its heading.

    Attributes:
        arm: the arm.
        free_space: of the tip, punctured at the base.
        goal: where the tip has to be.
        shrink: distance kept from corners where there is room [m].
        settings: numbers.
    """

    arm: Arm
    free_space: FreeSpace
    goal: GoalPose
    shrink: float
    settings: TipWalkSettings

    def straight_on(self, pose: Pose) -> FloatArray | None:
        """Back along the arm to the joint nearest to the goal, and over to it, shape (k, 2) [m]; None where closed."""
        entry, place = self._run_in(pose)
        nearest = int(np.argmin(np.linalg.norm(pose.points - entry, axis=1)))
        back = pose.points[max(nearest, 1) :][::-1]
        return self._led_onto(np.vstack((back, entry)), place, self.shrink)

    def drawn(self, pose: Pose, rng: np.random.Generator) -> tuple[FloatArray | None, bool]:
        """A path drawn at random, shape (k, 2) [m], None where it is closed; and whether it leads onto the goal."""
        settings = self.settings
        entry, place = self._run_in(pose)
        tip = pose.points[-1:]
        shrink = self.shrink * float(rng.choice(settings.rounding))
        onto_goal = bool(rng.random() < settings.onto_goal)
        if onto_goal and rng.random() >= settings.by_place:
            return self._led_onto(np.vstack((tip, entry)), place, shrink), True
        middle = place if rng.random() < settings.about_goal else tip[0]
        via = self._free_place(middle, rng)
        if not onto_goal:
            return self._led_onto(np.vstack((tip, via)), via, shrink), False
        return self._led_onto(np.vstack((tip, via, entry)), place, shrink), True

    def _led_onto(self, polyline: FloatArray, place: FloatArray, shrink: float) -> FloatArray | None:
        """The taut path in the class of a polyline (m, 2), led straight on to a place (2,), shape (k, 2) [m]."""
        try:
            taut = self.free_space.taut_path(polyline, shrink)
        except UnreachableGoal:
            return None
        return taut if np.array_equal(taut[-1], place) else np.vstack((taut, place))

    def _run_in(self, pose: Pose) -> tuple[FloatArray, FloatArray]:
        """Where the run onto the goal begins and ends, each of shape (2,) [m]; onto the member nearest to a pose."""
        member = self.goal.nearest_member(pose.points[-1], float(pose.headings[-1]))
        place = member.position
        if member.heading is None:
            return place, place
        for links in self.settings.run_in:
            entry = place - links * self.arm.length / NOMINAL_LINKS * unit_vector(member.heading)
            if self.free_space.contains(np.linspace(entry, place, self.settings.run_in_samples)).all():
                return entry, place
        return place, place

    def _free_place(self, middle: FloatArray, rng: np.random.Generator) -> FloatArray:
        """A place at some distance from another, free where that can be had with few draws, shape (2,) [m]."""
        settings = self.settings
        angles = rng.uniform(-np.pi, np.pi, settings.places_drawn)
        distances = self.arm.length * rng.uniform(settings.nearest, settings.farthest, settings.places_drawn)
        places = middle + distances[:, None] * unit_vector(angles)
        reached = np.linalg.norm(places - self.arm.base, axis=1) < self.arm.length
        free = np.flatnonzero(self.free_space.contains(places) & reached)
        return np.asarray(places[free[0] if len(free) else 0])
