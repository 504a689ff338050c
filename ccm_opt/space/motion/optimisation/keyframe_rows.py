"""Rows on single keyframes of a motion that a step of the optimisation has to keep, without slack."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ccm_opt.ground.arrays import FloatArray, IntArray

if TYPE_CHECKING:
    from collections.abc import Sequence


@dataclass(frozen=True, eq=False)
class KeyframeRows:
    """Rows on keyframes that have to hold, without slack.

    Attributes:
        keyframe: of each row, at least 1, shape (m,).
        rows: by the unknowns of that keyframe, shape (m, p).
        lower: what they have to gain at least, shape (m,).
        equal: how many of them, the first ones, may gain no more either.
    """

    keyframe: IntArray
    rows: FloatArray
    lower: FloatArray
    equal: int

    @classmethod
    def joined(cls, parts: "Sequence[KeyframeRows]") -> "KeyframeRows | None":
        """All rows of some parts, equations first; None of no parts."""
        if not parts:
            return None
        equations = [(part, slice(None, part.equal)) for part in parts]
        ordered = [*equations, *((part, slice(part.equal, None)) for part in parts)]
        return cls(
            np.concatenate([part.keyframe[some] for part, some in ordered]),
            np.vstack([part.rows[some] for part, some in ordered]),
            np.concatenate([part.lower[some] for part, some in ordered]),
            sum(part.equal for part in parts),
        )
