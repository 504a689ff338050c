"""Plans in the background while people drag: only the last place that was asked for counts."""

import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial

from ccm_opt.cli.view.view_settings import VIEW, ViewSettings
from ccm_opt.driver.live_plan import LiveAnswer, LivePlan
from ccm_opt.driver.live_plan_in_space import LivePlanInSpace
from ccm_opt.errors import CcmError


@dataclass
class Replanner:
    """Takes changes from any thread, plans them in one of its own, and tells what came of it.

    Attributes:
        live: the plan that follows.
        told: called, in the planner's thread, with the plan's answer or what is wrong with what was asked.
        settings: when it is quiet enough to plan anew.
    """

    live: LivePlan | LivePlanInSpace
    told: Callable[[LiveAnswer | str], None]
    settings: ViewSettings = VIEW
    _wanted: Callable[[], LiveAnswer] | None = None
    _fresh: bool = False
    _ended: bool = False
    _changed: threading.Condition = field(default_factory=threading.Condition)

    def start(self) -> None:
        """Begin to plan."""
        threading.Thread(target=self._run, daemon=True, name="replanner").start()

    def ask(self, change: Callable[[], LiveAnswer]) -> None:
        """Ask for a change; one that was asked for and not begun is forgotten."""
        with self._changed:
            self._wanted = change
            self._changed.notify()

    def end(self) -> None:
        """Plan nothing more."""
        with self._changed:
            self._ended = True
            self._changed.notify()

    def _run(self) -> None:
        while (change := self._next()) is not None:
            try:
                self.told(change())
            except CcmError as error:
                self.told(str(error))

    def _next(self) -> Callable[[], LiveAnswer] | None:
        """The next change; after some quiet a plan from nothing; None at the end."""
        with self._changed:
            while not self._ended:
                if self._wanted is not None:
                    change, self._wanted, self._fresh = self._wanted, None, True
                    return change
                heard = self._changed.wait(self.settings.quiet if self._fresh else None)
                if not heard and self._fresh:
                    self._fresh = False
                    return partial(self.live.plan_anew, self.settings.anew)
        return None
