"""The first thing to try among many walls: the tip led along its shortest path, with one margin after another."""

from dataclasses import dataclass

from ccm_opt.motion.failures import Failure
from ccm_opt.motion.motion_task import Motion, MotionTask
from ccm_opt.motion.portfolio import tip_led
from ccm_opt.motion.search_run import SearchRun


@dataclass(frozen=True)
class ShortestPathStrategy:
    """The tip led along its shortest path among many walls, with one planning margin after another.

    Which of them gets through a field of walls nobody can tell beforehand, and to try takes a tenth of a second.
    """

    name: str = "the shortest path"
    costly: bool = False
    leads_others: bool = False

    def applies(self, task: MotionTask) -> bool:
        """A goal of the whole arm is seldom met by a tip that is led."""
        many = len(task.workspace.walls) > task.settings.search.many_walls
        return many and not task.parametric and task.goal_headings is None and len(task.tip_paths) > 0

    def find(self, task: MotionTask, failures: list[Failure], nominal_links: float) -> Motion | None:
        """The motion with the first margin that gets through."""
        shortest = min(task.tip_paths, key=lambda path: path.length)
        for margin in task.settings.search.crowded_margins:
            run = SearchRun.from_task(task, margin, nominal_links)
            motion = run.run(iter((tip_led(run.stepper, run.start, shortest),)), failures)
            if motion is not None or task.deadline.passed():
                return motion
        return None
