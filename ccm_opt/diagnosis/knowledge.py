"""What is known of one kind of problems, in the plane or in space: all that the explanation of a failure asks for."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, TypeAlias

from ccm_opt.diagnosis.parameters import Parameter, WholeChange
from ccm_opt.errors import Finding
from ccm_opt.ground.deadline import Deadline

Findings: TypeAlias = tuple[Finding, ...]


@dataclass(frozen=True)
class Knowledge:
    """What is asked of a problem, as functions of it; all problems that are passed are of the same kind.

    Attributes:
        proved: findings of the necessary checks.
        hopeless: whether anything is proved, which takes less than to say what.
        likely: what is tight though nothing is proved, the tightest first.
        wider_room: the room made wide enough, by what is proved; None where that would not help.
        moved_goals: the goal moved or turned, by what is proved; until when it is looked for.
        left_out: what the goal asks for besides a place, left out, by what stands in the way.
        hints: advice where numbers look as if they were in another unit.
        room_name: what the walls of the room are called; they cannot be removed.
    """

    proved: Callable[[Any], Findings]
    hopeless: Callable[[Any], bool]
    likely: Callable[[Any], Findings]
    wider_room: Callable[[Any, Findings], WholeChange | None]
    moved_goals: Callable[[Any, Findings, Deadline], Iterator[Parameter]]
    left_out: Callable[[Any, Findings], Iterator[WholeChange]]
    hints: Callable[[Any], tuple[str, ...]]
    room_name: str


def heading_may_mend(finding: Finding) -> bool:
    """Whether a finding may be due to the heading, or the direction, asked for at the goal."""
    return finding.kind in {"too stiff", "contact", "curve"} and not finding.key.startswith("start")
