"""Rails: what holds the arm in the middle of narrow gates, and draws joints there so that links enter straight.

Walls alone would hold the arm askew in a gate as soon as a guide pulls at it: then the first order of a step leaves no
play, and the second takes what there is not. So that the axis crosses a gate in its middle is an equation of every
step, and of every inner keyframe of a motion; before and behind the gate joints are drawn to the middle line.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from ccm_opt.ground.arrays import FloatArray
from ccm_opt.motion.limits.gate_lines import GateLines
from ccm_opt.motion.limits.limit import KeyframeRows, Limit, LimitRows
from ccm_opt.motion.link_space import LinkSpace
from ccm_opt.motion.pose import Pose, Term
from ccm_opt.motion.settings.step_settings import RailSettings

if TYPE_CHECKING:
    from ccm_opt.motion.swept_motion import Sweep


@dataclass(frozen=True, eq=False)
class GateRails(Limit):
    """Holds the axis in the middle of gates, and draws joints onto their middle lines, across them alone.

    Attributes:
        rails: middle lines with their straight runs, each of shape (k ≥ 2, 2) [m].
        lines: across the gates.
        play: distance from a rail up to which a joint is left alone [m].
        settings: weight, and how far off a joint may be.
    """

    rails: tuple[FloatArray, ...]
    lines: GateLines
    play: float
    settings: RailSettings

    @cached_property
    def _legs(self) -> tuple[FloatArray, FloatArray]:
        """First points and directions of all legs, each (m, 3): the third number is the leg's length [m]."""
        first = np.vstack([rail[:-1] for rail in self.rails])
        along = np.vstack([np.diff(rail, axis=0) for rail in self.rails])
        length = np.linalg.norm(along, axis=1)
        kept = length > 0.0
        return first[kept], np.column_stack((along[kept] / length[kept, None], length[kept]))

    # ------------------------------------------------------------ the single step
    def linearised(self, space: LinkSpace, pose: Pose, jacobians: FloatArray, turn: float) -> LimitRows:
        """Equations of the lines that the axis crosses; a pull on every joint that is in a gate or on a run to it."""
        del turn
        unit = space.nominal_length
        found = self.lines.crossings(pose.points[None], self.settings.across * unit)
        crossed = found.crossed[0]
        slopes = self.lines.slopes(space, pose.headings[None], found)[0][crossed] / unit
        most = self.settings.catching_up
        back = np.clip(-found.aside[0][crossed] / unit, -most, most)
        rows = LimitRows(slopes, back, back, equations=len(back))
        pull = self._pull(space, pose, jacobians)
        return rows if pull is None else replace(rows, pulls=(pull,))

    def _pull(self, space: LinkSpace, pose: Pose, jacobians: FloatArray) -> Term | None:
        """What draws the joints on rails across them; None where there is none."""
        unit = space.nominal_length
        first, legs = self._legs
        off = pose.points[:, None] - first
        along = np.einsum("jmk,mk->jm", off, legs[:, :2])
        across = off[..., 1] * legs[:, 0] - off[..., 0] * legs[:, 1]
        within = (along >= 0.0) & (along <= legs[:, 2])
        beside = np.where(within, np.abs(across), np.inf)
        leg = np.argmin(beside, axis=1)
        joint = np.flatnonzero(beside[np.arange(len(leg)), leg] < self.settings.beside * unit)
        joint = joint[joint > 0]  # the base cannot move
        if len(joint) == 0:
            return None
        chosen = leg[joint]
        normal = np.column_stack((-legs[chosen, 1], legs[chosen, 0]))
        slopes = np.einsum("jk,jkp->jp", normal, jacobians[joint]) / unit
        apart = across[joint, chosen]
        wanted = -np.sign(apart) * np.maximum(np.abs(apart) - self.play, 0.0) / unit
        return Term(slopes, wanted, self.settings.weight)

    def restored(self, space: LinkSpace, v: FloatArray, most: float) -> FloatArray:
        """Coordinates after a step moved so that the axis crosses in the middle; as they are where that fails."""
        moved = self.lines.restored(space, v[None])[0]
        return moved if np.max(np.abs(space.matrix @ (moved - v))) <= most else v

    # ------------------------------------------------------------ at the goal
    def missed(self, space: LinkSpace, headings: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Slopes of the lines that a pose crosses, shape (k, p), and how far it has to be moved across them [m]."""
        found = self.lines.crossings(space.arm.points(headings)[None], self.settings.across * space.nominal_length)
        crossed = found.crossed[0]
        return self.lines.slopes(space, headings[None], found)[0][crossed], -found.aside[0][crossed]

    def met(self, pose: Pose) -> bool:
        """Whether a pose crosses every line in the middle, up to the play beside which joints are left alone."""
        found = self.lines.crossings(pose.points[None], np.inf)
        return bool(np.all(np.abs(found.aside) <= self.play))

    # ------------------------------------------------------------ the optimisation of a motion
    def keyframe_equations(self, sweep: "Sweep", u: FloatArray) -> tuple[KeyframeRows, ...]:
        """Equations of the lines that are crossed by inner keyframes; both ends stand where they do."""
        del u
        space = sweep.space
        links = space.arm.links
        found = self.lines.crossings(sweep.points[:, : links + 1], self.settings.across * space.nominal_length)
        slopes = self.lines.slopes(space, sweep.headings, found) / space.nominal_length
        crossed = found.crossed.copy()
        crossed[[0, -1]] = False
        keyframe, line = np.nonzero(crossed)
        zero = np.zeros(len(keyframe))
        return (KeyframeRows(keyframe, slopes[keyframe, line], zero, zero),)

    def restored_keyframes(self, space: LinkSpace, coordinates: FloatArray, u: FloatArray) -> FloatArray:
        """Inner keyframes moved so that they cross in the middle."""
        del u
        return np.vstack((coordinates[:1], self.lines.restored(space, coordinates[1:-1]), coordinates[-1:]))
