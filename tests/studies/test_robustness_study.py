"""The sweep `robustness`: starts that differ in loss and noise alone, and verdicts of made-up tables."""

from itertools import product

import numpy as np
import pandas as pd

from studies.core.statement import FAILS, HOLDS
from studies.patent.robustness_study import (
    BASE,
    CONTROLLERS,
    LOSSES,
    NOISES,
    NUMBERS,
    ROBUSTNESS,
    RULES,
    cells,
    meant,
)


def robustness_table(gain: float = 0.02, lost: float = 0.001, starts: int = 20) -> pd.DataFrame:
    """Sharing gains so much of the bound, `lost` less where most telegrams are lost; noise takes a twentieth of all."""
    random = np.random.default_rng(6)
    rows = []
    for k, loss, noise in product(range(starts), LOSSES, NOISES):
        day = 0.01 * random.normal()
        for controller, rule in product(CONTROLLERS, RULES):
            used = 0.9 - 0.05 * noise / NOISES[-1] + day + 0.001 * random.normal()
            used += (rule != BASE) * (gain - lost * loss / LOSSES[-1])
            where = {"event": f"{k}", "loss": loss, "noise": noise, "rule": rule}
            row = where | {"scenario": f"{k}-{loss}-{noise}", "controller": controller}
            rows.append(row | {"status": "ok"} | dict.fromkeys(NUMBERS, 1.0) | {"bound_use": used})
    return pd.DataFrame(rows)


def test_gain_and_loss_are_judged_apart():
    for gain, lost, verdicts in (
        (0.02, 0.001, (HOLDS, HOLDS)),
        (0.04, 0.03, (HOLDS, FAILS)),
        (-0.02, 0.0, (FAILS, HOLDS)),
    ):
        found = ROBUSTNESS.statements(robustness_table(gain, lost))
        for kind, verdict in zip(("gain", "loss"), verdicts, strict=True):
            own = [one.verdict for one in found if one.name.endswith(kind)]
            assert own == [verdict] * len(CONTROLLERS), (gain, lost, kind)


def test_starts_differ_in_loss_and_noise_alone_and_rows_say_them():
    jobs = cells(3, 1, 4.0)
    assert len({job.label for job in jobs}) == len(jobs)
    plain = jobs[0].scenario
    told = meant(pd.DataFrame([{"scenario": job.scenario.name} for job in jobs]), 3, 2)
    assert set(told["event"]) == {"headroom-3-0001"}
    for job, loss, noise in zip(jobs, told["loss"], told["noise"], strict=True):
        event = job.scenario.event()
        assert event.onboard.telegrams.loss == loss
        assert abs(3.6 * event.onboard.sensors.speed_noise - noise) < 1e-12
        assert job.scenario.changed(name=plain.name, onboard=plain.onboard.model_dump()) == plain
    assert set(zip(told["loss"], told["noise"], strict=True)) == set(product(LOSSES, NOISES))
