"""Deadlines: CPU time ends the work, and wall time only when the process gets hardly any."""

import math
import time
from dataclasses import dataclass

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ccm_opt.core import deadline as module
from ccm_opt.core.deadline import WALL_GUARD, Deadline

GUARD = WALL_GUARD


@dataclass
class Clocks:
    """Two clocks that stand until they are moved, in place of the module ``time``."""

    cpu: float = 5.0
    wall: float = 1000.0

    def process_time(self) -> float:
        """CPU time [s]."""
        return self.cpu

    def monotonic(self) -> float:
        """Wall time [s]."""
        return self.wall

    def work(self, seconds: float, slowness: float = 1.0) -> None:
        """Move both clocks on; a second of CPU time takes ``slowness`` seconds."""
        self.cpu += seconds
        self.wall += slowness * seconds


@pytest.fixture
def clocks(monkeypatch: pytest.MonkeyPatch) -> Clocks:
    """Clocks that the deadlines look at."""
    fake = Clocks()
    monkeypatch.setattr(module, "time", fake)
    return fake


@pytest.mark.parametrize("slowness", [1.0, 1.7, 2.9])
def test_the_same_work_is_done_on_a_busy_machine(clocks: Clocks, slowness: float) -> None:
    """Up to the guard, the load decides neither when the time is up nor how much of it is left."""
    deadline = Deadline.after(10.0)
    clocks.work(9.9, slowness)
    assert not deadline.passed()
    assert deadline.left == pytest.approx(0.1)
    clocks.work(0.2, slowness)
    assert deadline.passed()
    assert deadline.what_passed() == "time limit reached"


def test_a_process_that_gets_no_cpu_time_ends_too(clocks: Clocks) -> None:
    """After three times the limit on the wall the work ends, and the words say which clock it was."""
    deadline = Deadline.after(10.0)
    clocks.wall += GUARD * 10.0 - 0.1
    assert not deadline.passed()
    clocks.wall += 0.2
    assert deadline.passed()
    assert "wall time" in deadline.what_passed()


@given(whole=st.floats(0.1, 100.0), share=st.floats(0.0, 2.0), worked=st.floats(0.0, 120.0), slowness=st.floats(1, 5))
def test_a_share_never_outlasts_the_whole(whole: float, share: float, worked: float, slowness: float) -> None:
    """A share ends no later than what it is a share of, by either clock, and no later than it says."""
    with pytest.MonkeyPatch.context() as patch:
        clocks = Clocks()
        patch.setattr(module, "time", clocks)
        deadline = Deadline.after(whole)
        clocks.work(min(worked, whole), slowness)
        part = deadline.within(share * whole)
        assert part.left <= deadline.left + 1e-9
        assert part.left <= share * whole + 1e-9
        clocks.work(share * whole + 1e-6)
        assert part.passed()


def test_never_is_never_over(clocks: Clocks) -> None:
    """A deadline that never comes leaves all the time there is, and its shares are as long as they say."""
    clocks.work(1e9)
    assert not Deadline.never().passed()
    assert Deadline.never().left == math.inf
    assert Deadline.never().within(2.0).left == pytest.approx(2.0)


def test_sleep_is_no_work() -> None:
    """On the true clocks, too, time that others use up is not counted."""
    deadline = Deadline.after(0.5)
    time.sleep(0.7)
    assert not deadline.passed()
