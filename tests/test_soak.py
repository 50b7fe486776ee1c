"""The soak test in small: what its actions leave is whole."""

import pytest

from tests.soak import soak


@pytest.mark.slow
def test_a_few_random_actions_lose_nothing_and_leave_nothing(tmp_path, capsys):
    assert soak(tmp_path, seed=879, disk=None, actions=4) == []
    assert "seed 879: 4 actions" in capsys.readouterr().out
