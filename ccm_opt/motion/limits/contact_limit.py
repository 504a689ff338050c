"""The contact limit: the arm keeps clear of walls and of itself.

In a step every near pair is a row; over an interval of a motion every link has half-planes and partners to keep from;
between keyframes the certificate bounds how far links may stray.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ccm_opt.collision.certificate import Certificate
from ccm_opt.collision.contact_finder import ContactFinder
from ccm_opt.collision.contacts import WALL, Contacts
from ccm_opt.ground.arrays import FloatArray, IntArray
from ccm_opt.motion.limits.clearance_rows import IntervalRows, motion_rows
from ccm_opt.motion.limits.gate_lines import GateLines
from ccm_opt.motion.limits.limit import UNBOUNDED, Limit, LimitRows
from ccm_opt.motion.link_space import LinkSpace
from ccm_opt.motion.pose import Pose, Term
from ccm_opt.motion.settings.step_settings import StepSettings

if TYPE_CHECKING:
    from ccm_opt.motion.swept_motion import Sweep


@dataclass(frozen=True, eq=False)
class ContactLimit(Limit):
    """Keeps gaps open.

    Attributes:
        finder: of near pairs; its margin is kept where there is room, its reach says which pairs make rows.
        certificate: of what lies between keyframes.
        settings: of the step.
        wanted: room beyond contact that the optimisation of a motion asks for where there is so much [m].
        gates: in which links are asked for no more than the certificate asks; None where there are none.
    """

    finder: ContactFinder
    certificate: Certificate
    settings: StepSettings
    wanted: float = 0.0
    gates: GateLines | None = None

    # ------------------------------------------------------------ the single step
    def linearised(self, space: LinkSpace, pose: Pose, jacobians: FloatArray, turn: float) -> LimitRows:
        """A row for each near pair: its gap may close by a share of what it has beyond the margin, no more."""
        del turn
        finder = self.finder
        settings = self.settings
        contacts = finder.find(pose.points)
        rows = contact_rows(contacts, jacobians)
        # n·J δ ≥ −share · (gap − margin): a pair inside its margin may stay, and the push mends it softly. Where
        # margins are narrow the row asks for some of it: a gap that only may not shrink is taken by the second order.
        beyond = contacts.gap - contacts.margin
        lower = np.where(beyond >= 0.0, -settings.closing_share * beyond, -settings.firm_share * beyond)
        # A start that stands nearer than the margin is legal; what it lacks is granted to every pose of the step.
        allowed = allowed_shortfall(contacts, settings.keep_share)

        def keeps(trial: Pose) -> bool:
            # Distances have no sign: a thin link that has jumped across a wall shows a positive gap on the other side,
            # so crossings are tested apart.
            after = finder.find(trial.points)
            return keeps_clear(after, allowed, settings.keep_share) and not finder.crosses(trial.points)

        push = self._push(space, contacts, rows)
        return LimitRows(rows, lower, np.full(len(rows), UNBOUNDED), pulls=(push,), keeps=keeps)

    def _push(self, space: LinkSpace, contacts: Contacts, rows: FloatArray) -> Term:
        """Ask contacts inside their margin to be mended."""
        wanted = contacts.margin - contacts.gap
        near = wanted > 0.0
        # In nominal links, so that the weight suits an arm of any size.
        unit = space.nominal_length
        return Term(rows[near] / unit, self.settings.mending_share * wanted[near] / unit, self.settings.push_weight)

    def keeps_at_goal(self, space: LinkSpace, near: Pose, final: Pose) -> bool:
        """Whether the pose on the goal keeps clear, or no less than the one near it."""
        del space
        allowed = allowed_shortfall(self.finder.find(near.points), self.settings.keep_share)
        after = self.finder.find(final.points)
        return keeps_clear(after, allowed, self.settings.keep_share) and not self.finder.crosses(final.points)

    # ------------------------------------------------------------ whole motions
    def interval_rows(self, sweep: "Sweep") -> tuple[IntervalRows, ...]:
        """Rows from the regions about a motion's own sweep, and of its near pairs of links."""
        workspace = self.certificate.workspace
        finder = self.finder
        link_margins = finder.settings.link_margins
        most = self._most_in_gates(sweep)
        asked = (link_margins, self.wanted, most)
        return (motion_rows(sweep, workspace, workspace.wall_segments, finder.margin, finder.reach, *asked),)

    def _most_in_gates(self, sweep: "Sweep") -> FloatArray | None:
        """Most gap that links are asked to keep from walls in each interval, shape (K, links) [m]; None for no gates.

        An interval has one slack: with more asked in a gate than there is, all of its other rows would be bought off.
        """
        if self.gates is None:
            return None
        arm = sweep.space.arm
        inside = self.gates.holds_links(sweep.points[:, : arm.links + 1], arm.radius)
        return np.where(inside[:-1] | inside[1:], self.certificate.spare, np.inf)

    def failures(self, headings: FloatArray, depth: int | None = None) -> IntArray:
        """Intervals in which something may touch."""
        return self.certificate.failures(headings, depth)


def keeps_clear(contacts: Contacts, allowed: float, keep_share: float) -> bool:
    """Whether every gap is at least its share of the margin, less what was allowed [m]."""
    floor = keep_share * contacts.margin - allowed
    return bool(np.all(contacts.gap >= np.minimum(floor, keep_share * contacts.margin)))


def allowed_shortfall(contacts: Contacts, keep_share: float) -> float:
    """How far below its share of the margin the worst gap already is; a step may not make it worse [m]."""
    return max(0.0, float(np.max(keep_share * contacts.margin - contacts.gap, initial=0.0)))


def contact_rows(contacts: Contacts, jacobians: FloatArray) -> FloatArray:
    """Derivative of every gap by the coordinates, shape (m, p).

    Args:
        contacts: near pairs of a pose.
        jacobians: of its joints, shape (links + 1, 2, p) [m per unit].
    """
    relative = _point_jacobian(jacobians, contacts.first, contacts.first_at)
    # gap = n·(x_first − x_second): a wall stands still, a second link moves and subtracts its own part.
    with_itself = contacts.second != WALL
    relative[with_itself] -= _point_jacobian(jacobians, contacts.second[with_itself], contacts.second_at[with_itself])
    rows: FloatArray = np.einsum("md,mdp->mp", contacts.normal, relative)
    return rows


def _point_jacobian(jacobians: FloatArray, link: IntArray, at: FloatArray) -> FloatArray:
    """Derivative of points on links, linear between the joints, shape (m, 2, p)."""
    share = at[:, None, None]
    mixed: FloatArray = (1.0 - share) * jacobians[link] + share * jacobians[link + 1]
    return mixed
