"""What of a property or a list of cases runs in `make test`, and what in `make nightly`."""

from collections.abc import Iterable

import pytest
from hypothesis import settings


def examples(count: int, *, nightly: int) -> settings:
    """As many examples as ``make test`` has time for, and as many as a night has."""
    return settings(max_examples=count if settings.default.derandomize else nightly)


def spared(cases: Iterable, long: Iterable) -> list:
    """The cases (of several arguments: tuples) as parameters, the long ones for the night."""
    cases, long = list(cases), list(long)
    assert set(long) <= set(cases)
    return [
        pytest.param(*(case if isinstance(case, tuple) else (case,)), marks=[pytest.mark.nightly] * (case in long))
        for case in cases
    ]
