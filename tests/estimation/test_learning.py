"""What a train has learnt stays with it: out of a run, into its file, and back as it was."""

import numpy as np
import pytest
import xarray as xr

from alloc.errors import EstimationError
from alloc.estimation.increments import learnt_in, load_learning, save_learning
from alloc.onboard.increment_learning import Increments, LearntIncrements

LEARNT = LearntIncrements(
    (0.0, 0.011), (0.0, 0.004), (10.0, 25.0), (0.0, 0.013), (0.0, 1.0), (0.0, 3.0)
)
OTHER = LearntIncrements(*(tuple(0.1 / 3.0 for _ in range(4)) for _ in range(6)))


def test_a_file_keeps_everything(tmp_path):
    path = tmp_path / "learnt.json"
    save_learning(path, "train", {"forward": LEARNT, "backward": OTHER})
    assert load_learning(path, "train") == {"forward": LEARNT, "backward": OTHER}


def test_no_file_is_no_experience(tmp_path):
    assert load_learning(tmp_path / "none.json", "train") == {}


def test_a_run_says_what_is_known_by_its_end():
    run = xr.Dataset(
        {f"learnt_{name}": ("unit", np.array(getattr(LEARNT, name))) for name in Increments._fields}
    )
    assert learnt_in(run) == LEARNT
    with pytest.raises(EstimationError, match="nothing is learnt in this run"):
        learnt_in(xr.Dataset())


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("{", "damaged"),
        ("[]", "damaged"),
        ('{"train": "train", "directions": {"up": {}}}', "damaged.*up"),
        ('{"train": "train", "directions": {"forward": {"magic": [1.0]}}}', "damaged.*magic"),
        ('{"train": "train", "directions": {"forward": {"increment": [0.0]}}}', "damaged"),
        ('{"train": "train", "directions": {"forward": 3}}', "damaged"),
        ('{"train": "other", "directions": {}}', "belongs to train 'other'"),
    ],
)
def test_bad_files_are_refused(tmp_path, content, message):
    path = tmp_path / "learnt.json"
    path.write_text(content)
    with pytest.raises(EstimationError, match=message):
        load_learning(path, "train")


def test_a_file_that_cannot_be_written_is_named(tmp_path):
    with pytest.raises(EstimationError, match="cannot be written"):
        save_learning(tmp_path / "no" / "learnt.json", "train", {})
