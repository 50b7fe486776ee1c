"""The soak test in small: what its actions leave is whole."""

from tests.soak import soak


def test_a_few_random_actions_lose_nothing_and_leave_nothing(capsys):
    assert soak(seed=5, minutes=float("inf"), actions=3) == []
    assert "seed 5: 3 actions" in capsys.readouterr().out
