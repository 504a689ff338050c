"""Of tests that are marked so, some cases are run, others in every run."""

from dataclasses import dataclass
from typing import cast

import pytest
from hypothesis import given
from hypothesis import strategies as st

from .drawn_cases import left_out_cases


@dataclass(frozen=True, eq=False)
class Case:
    """What is asked of a case of a test."""

    nodeid: str
    mark: pytest.Mark | None

    def get_closest_marker(self, _: str) -> pytest.Mark | None:
        """Return its mark."""
        return self.mark


@given(st.integers(0, 2**32), st.integers(1, 9), st.integers(1, 9), st.integers(0, 9))
def test_as_many_as_are_marked_are_run(seed: int, count: int, own: int, others: int) -> None:
    """A seed draws so many of a test's cases, and of a group in several files, and leaves out nothing unmarked."""
    alone = pytest.mark.drawn(count).mark
    grouped = pytest.mark.drawn(count, of="things").mark
    cases = [Case(f"a.py::test_one[{k}]", alone) for k in range(own)]
    cases += [Case(f"{'ab'[k % 2]}.py::test_{k}", grouped) for k in range(others)]
    cases += [Case("a.py::test_unmarked", None)]
    items = cast("list[pytest.Item]", cases)
    left_out = left_out_cases(items, str(seed))
    run = [case for case, item in zip(cases, items, strict=True) if item not in left_out]
    for mark, of in ((alone, own), (grouped, others)):
        assert sum(case.mark is mark for case in run) == min(count, of)
    assert cases[-1] in run
    assert left_out_cases(items, str(seed)) == left_out


def test_every_case_is_run_in_some_run() -> None:
    """No seed draws what all others draw."""
    cases = cast("list[pytest.Item]", [Case(f"a.py::test_one[{k}]", pytest.mark.drawn(2).mark) for k in range(10)])
    assert set.intersection(*(left_out_cases(cases, str(seed)) for seed in range(200))) == set()
