"""What the MPC believes of a rail whose adhesion has fallen, beside what the rail is: by curve."""

from dataclasses import replace
from typing import Any

import numpy as np

from alloc.onboard.host import TorqueDecision, UnitSense
from alloc.onboard.parameters import Sensors
from alloc.plant.adhesion import (
    POLACH_DRY,
    POLACH_WET,
    AdhesionCurve,
    PiecewiseCurve,
    SlipRatioCurve,
)
from alloc.plant.model import build
from alloc.plant.rail import Patch, Rail
from alloc.plant.sets import find_set
from mpc.unit import MpcController
from tests.mpc.drop import between, driven, drop_event, run_mpc

CURVES: dict[str, AdhesionCurve] = {
    "piecewise": PiecewiseCurve(),
    "polach": POLACH_WET,
    "polach-dry": POLACH_DRY,
    "slip-ratio": SlipRatioCurve(),
    "slip-ratio-0.02": SlipRatioCurve(0.02),
}
LEVEL, FALL, FALLS_AT = 0.18, 0.6, 4.0
"""Adhesion before it falls, what is left of it, and when it falls [s]."""
SINCE, DURATION = 8.0, 10.0
"""From when on estimates count [s], and when the run ends [s]."""


class Remembering(MpcController):
    """The MPC of a unit that keeps what it believes after each period."""

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self.believed: list[tuple[float, float, float, float]] = []
        """Time [s], slip of the peak [m/s], slip sought [m/s], mean of the peaks, a period each."""

    def decide(self, sense: UnitSense) -> TorqueDecision:
        """As the MPC."""
        answer = super().decide(sense)
        belief = self.belief
        self.believed.append(
            (
                sense.time,
                float(belief.record.curve.state[0].top),
                float(belief.record.search.state[0].slip),
                float(belief.peak.mean()),
            )
        )
        return answer


def estimates(curve: str, noise: float = 0.0) -> dict[str, float]:
    """Means over units and time once the adhesion has fallen; `noise` of all speeds [km/h].

    Slips in m/s: of the rail's peak, estimated, sought; the errors relative; the adhesion used as a share.
    """
    patch = Patch(FALL, begin=FALLS_AT, until=2.0 * DURATION, fade=0.1)
    rail = Rail(LEVEL, patches=(patch,), curve=CURVES[curve])
    sensors = Sensors(speed_noise=noise / 3.6)
    event = replace(
        drop_event(duration=DURATION, sensors=sensors),
        model=build(find_set("commuter-8car"), rail),
    )
    run, controllers = run_mpc(event, controller=Remembering)
    late = between(run, SINCE, DURATION)
    true = {
        name: run[name].values[late][:, driven(run)]
        for name in ("peak_slip", "adhesion_limit", "coefficient")
    }
    believed = np.concatenate([np.array(one.believed) for one in controllers])
    _, top, sought, peak = believed[believed[:, 0] >= SINCE].mean(axis=0)
    peak_slip, limit = (float(true[name].mean()) for name in ("peak_slip", "adhesion_limit"))
    return {
        "peak_slip": peak_slip,
        "estimated": top,
        "slip_error": top / peak_slip - 1.0,
        "sought": sought,
        "peak_error": peak / limit - 1.0,
        "used": float((true["coefficient"] / true["adhesion_limit"]).mean()),
        "failures": run.attrs["controller_failures"],
    }
