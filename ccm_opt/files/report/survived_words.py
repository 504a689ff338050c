"""The errors that a plan survives in words for people: what is wrong, by how much it may be, and what limits it."""

import re
from dataclasses import dataclass

from ccm_opt.files.report.check_words import joint_in_words
from ccm_opt.files.report.page_units import PageUnits
from ccm_opt.solution import SurvivedError

_WRONG = {
    "joints": "every joint off by",
    "link lengths": "every link longer or shorter by",
    "base heading": "base turned by",
    "base position": "base beside its place by",
    "walls": "every wall nearer by",
    "payload": "mass at the tip",
    "friction": "friction in every joint",
}
_TIME = re.compile(r" at t = (\d+(?:\.\d+)?) s")


@dataclass(frozen=True)
class SurvivedWords:
    """One error for people.

    Attributes:
        wrong: what is otherwise than planned.
        size: the largest that is survived, with its unit.
        where: what limits it, and when.
    """

    wrong: str
    size: str
    where: str


def survived_in_words(error: SurvivedError, units: PageUnits, *, in_space: bool) -> SurvivedWords:
    """The words of one error.

    Args:
        error: that is survived, with what limits it.
        units: of the page or table.
        in_space: whether joints have two bends, which are told apart.
    """
    where = _TIME.sub(lambda time: f" at {float(time[1]):.2f} s", error.where)
    least = "" if error.limited else "≥ "
    return SurvivedWords(
        _WRONG.get(error.name, error.name),
        least + units.shown(error.size, error.unit, error.size),
        joint_in_words(where, in_space=in_space),
    )
