"""Requirements on every plan of many arms."""

from __future__ import annotations

import time
from collections.abc import Callable
from types import SimpleNamespace

import numpy as np
import pytest

import rr1plan as rp
from rr1plan import ManyArmsResult
from rr1plan.collision import CollisionChecker
from rr1plan.multi import stopwatch


def check_plan(problem: rp.Problem, result: ManyArmsResult, samples: int = 150) -> None:
    """Check that the referee certifies the motion and that Coal finds no contact at many instants."""
    assert result.found, result.reason
    assert result.trajectory is not None
    report = rp.validate(result.trajectory, problem.scene, problem)
    assert report.certified, report
    checker = CollisionChecker(problem.scene, problem.arms)
    times = np.linspace(result.trajectory.start_time, result.trajectory.end_time, samples)
    assert all(checker.is_free_slowly(q) for q in result.trajectory(times))


@pytest.fixture(scope="session")
def assert_safe() -> Callable[..., None]:
    return check_plan


@pytest.fixture
def processor_clock(monkeypatch: pytest.MonkeyPatch) -> None:
    """Budgets of many arms count processor time, of which other programs take nothing."""
    monkeypatch.setattr(stopwatch, "time", SimpleNamespace(perf_counter=time.process_time))
