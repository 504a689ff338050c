"""The columns of a joint path, the bends and perhaps the feed axis, with the limits on each."""

from dataclasses import dataclass

import numpy as np

from ccm_opt.arrays import FloatArray, IntArray
from ccm_opt.errors import Diagnosis, RetimingError
from ccm_opt.problem import Limits


@dataclass(frozen=True)
class Axes:
    """Limits on the columns of a path: one bend a link and, when there is one more column, the feed axis.

    Attributes:
        velocity: shape (n,) [rad/s, m/s].
        acceleration: shape (n,) [rad/s², m/s²].
        jerk: shape (n,) [rad/s³, m/s³], inf where it is not limited.
        number: of the revolute that a column turns; the feed axis has the number after the last revolute, shape (n,).
    """

    velocity: FloatArray
    acceleration: FloatArray
    jerk: FloatArray
    number: IntArray

    @property
    def smooth(self) -> bool:
        """Whether jerk is limited."""
        return bool(np.any(np.isfinite(self.jerk)))

    @classmethod
    def of(cls, limits: Limits, columns: int) -> "Axes":
        """The limits of so many columns; ball i's bend is revolute 3 i + 1.

        Raises:
            RetimingError: when there are neither as many columns as links, nor one more with its limits.
        """
        revolutes = len(limits.velocity)
        bends = 3 * np.arange(revolutes // 3) + 1
        jerk = np.full(len(bends), np.inf) if limits.jerk is None else limits.jerk[bends]
        if columns == len(bends):
            return cls(limits.velocity[bends], limits.acceleration[bends], jerk, bends)
        if columns != len(bends) + 1 or limits.feed_velocity is None or limits.feed_acceleration is None:
            raise _wrong_columns(columns, len(bends))
        return cls(
            np.append(limits.velocity[bends], limits.feed_velocity),
            np.append(limits.acceleration[bends], limits.feed_acceleration),
            np.append(jerk, limits.feed_jerk or np.inf),
            np.append(bends, revolutes),
        )


def _wrong_columns(columns: int, links: int) -> RetimingError:
    return RetimingError(
        Diagnosis(
            reason=f"the path has {columns} columns; expected {links} bends, or one more for a feed axis with limits "
            "on its velocity and acceleration",
            stage="retiming",
            advice=("give limits.feed_velocity and limits.feed_acceleration",),
            evidence={"columns": columns, "links": links},
        )
    )
