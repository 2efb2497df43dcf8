"""What of a property or a list of cases runs in `make test`, and what in `make nightly`."""

from collections.abc import Iterable

import pytest
from hypothesis import settings


def examples(count: int, *, nightly: int) -> settings:
    """As many examples as ``make test`` has time for, and as many as a night has."""
    return settings(max_examples=count if settings.default.derandomize else nightly)


def spared(cases: Iterable[str], long: Iterable[str]) -> list:
    """The cases as parameters, the long ones for the night."""
    cases, long = list(cases), list(long)
    assert set(long) <= set(cases)
    return [pytest.param(case, marks=pytest.mark.nightly) if case in long else case for case in cases]
