"""The MPC's settings at half and at double: each alone is changed, and the table says by how much the rows differ."""

import numpy as np
import pandas as pd

from studies.mpc_settings import AS_IT_SHIPS, DOUBLE, HALF, change_settings, table


def values(controller):
    return {name: controller.memory.columns[name].default for name in controller.settings}


def test_each_setting_alone_is_halved_and_doubled():
    found = change_settings()
    usual = values(found[AS_IT_SHIPS])
    for (name, factor), controller in found.items():
        others = {key: value for key, value in values(controller).items() if key != name}
        assert others == {key: value for key, value in usual.items() if key != name}
        if name not in ("", "late"):
            assert values(controller)[name] == type(usual[name])(factor * usual[name])
    assert {name for name, factor in found if factor == DOUBLE} == {*usual}
    assert {name for name, factor in found if factor == HALF} == {*usual} - {"late"}


def test_its_table_has_the_differences_of_the_rows():
    rows = [
        {"scenario": f"event {k}", "setting": name, "factor": factor, "status": "ok"}
        | {"bound_use": 0.9 - 0.01 * (name == "gain") * factor, "damage": 100.0 * factor}
        for k in range(9)
        for name, factor in change_settings()
    ]
    found = table(pd.DataFrame(rows)).set_index("setting")
    assert found.loc["`gain`", "half [points]"].startswith("−0.50")
    assert found.loc["`gain`", "double [points]"].startswith("−2.00")
    assert set(found["double: Q [%]"]) == {"+100"}
    assert found.loc["`late`", "half: Q [%]"] == ""
    assert np.unique(found["meaning"]).size == len(found)
