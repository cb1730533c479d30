"""A machine at work that each test disturbs."""

from __future__ import annotations

from typing import Any

import pytest
from topdress.control.orders import Do

from tests.safety.steps import Run


@pytest.fixture
def new_run() -> type[Run]:
    return Run


@pytest.fixture
def working() -> Any:
    """A factory of runs that are at work with flow."""

    def make(**settings: Any) -> Run:
        run = Run(**settings)
        assert run.order(Do.READY).accepted
        run.tick()
        assert run.order(Do.START).accepted
        verdict = run.tick(0.5)
        assert verdict.flow_allowed, verdict
        return run

    return make


@pytest.fixture
def calibrating() -> Any:
    """A factory of runs in calibrating, standing still."""

    def make(seconds: float | None = None, **settings: Any) -> Run:
        run = Run(**settings)
        run.order(Do.READY)
        run.tick(speed_mps=0.0)
        assert run.order(Do.CALIBRATE, seconds).accepted
        assert run.tick(speed_mps=0.0).flow_allowed
        return run

    return make
