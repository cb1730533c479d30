"""Rules that the tests themselves keep."""
from __future__ import annotations

import pytest


def test_no_name_of_a_test_floods_a_terminal(request: pytest.FixtureRequest) -> None:
    assert [item.nodeid[:200] for item in request.session.items if len(item.nodeid) > 300] == []
