"""Who draws and saves plans: a solution knows that somebody does; those who can, floors above, say so themselves."""

from pathlib import Path
from typing import Any, Protocol


class Presenter(Protocol):
    """Draws, animates and saves plans."""

    def plot(self, plan: Any) -> Any:
        """A figure of a plan."""
        ...

    def animate(self, plan: Any, file: str | Path) -> Path:
        """Write a film of a plan."""
        ...

    def save(self, solution: Any, folder: str | Path) -> Path:
        """Write the folder of a plan."""
        ...


_PRESENTERS: list[Presenter] = []
"""Those who have said that they can; the last counts."""


def present_with(presenting: Presenter) -> None:
    """Let somebody draw and save plans from now on."""
    _PRESENTERS.append(presenting)


def presenter() -> Presenter:
    """Who draws and saves plans.

    Raises:
        RuntimeError: nobody has said that they can; what ``ccm_opt`` hands out does.
    """
    if not _PRESENTERS:
        raise RuntimeError("nothing that draws and saves plans is loaded; import ccm_opt.files.saved_plans first")
    return _PRESENTERS[-1]
