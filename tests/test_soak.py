"""The soak test in small: what its actions leave is whole."""

from tests.soak import soak


def test_a_few_random_actions_lose_nothing_and_leave_nothing(capsys):
    assert soak(seed=7, minutes=float("inf"), actions=4) == []
    assert "seed 7: 4 actions" in capsys.readouterr().out
