"""The MPC's parts exchange_parts: each works, and differences are those of the same events."""

from dataclasses import replace

import pandas as pd
import pytest

from alloc.onboard.controllers import CONTROLLERS
from studies.mpc_parts import STUDY, exchange_parts
from studies.runner.study import run_study
from tests.cases import looped
from tests.wheel import drive

PARTS = exchange_parts()
# a row that begins as the MPC's is one to what was compiled for that; Numba calls this experimental
pytestmark = pytest.mark.filterwarnings("ignore:.*experimental feature")


@looped("name", PARTS)
def test_every_part_holds_a_slip_near_the_peak(name):
    slip, mu, command, _ = drive(PARTS[name], lambda t: 0.08, 0.1, 8.0)
    # without a swing no search moves, and the slip stays where it begins
    least = {"own search above the believed line, inverted": 0.8, "no swing": 0.9}
    assert mu[-300:].mean() > least.get(name, 0.94) * 0.08
    assert slip[-300:].max() < 0.5
    assert 0.0 < command[-300:].min() < command[-300:].max() < 0.15


def test_a_search_alone_and_a_horizon_alone_are_neither_of_the_two():
    courses = [drive(one, lambda t: 0.08, 0.15, 6.0)[2] for one in PARTS.values()]
    courses.append(drive(CONTROLLERS["mpc"], lambda t: 0.08, 0.15, 6.0)[2])
    assert len({one.tobytes() for one in courses}) == len(courses)


def test_its_table_has_differences_over_the_same_events(tmp_path):
    whole, other = "mpc", "horizon of 2"

    def cells(events, seed):
        return [one for one in STUDY.cells(events, seed) if one.columns["part"] in (whole, other)]

    rows = run_study(replace(STUDY, cells=cells), tmp_path, 2)
    assert set(rows["status"]) == {"ok"}
    used = rows.groupby("part")["bound_use"].mean() * 100.0
    assert abs(used[whole] - used[other]) > 1e-3
    every = [rows[rows["part"] == whole].assign(part=one) for one in (whole, *PARTS)]
    found = STUDY.table(pd.concat(every)).set_index("part")["adhesion used [points]"]
    assert found[whole] == f"{used[whole]:.2f}"
    assert set(found[1:]) == {"+0.00"}
