"""Readhesion controllers: what a traction unit does with its torque when its wheels slip.

`CONTROLLERS` has all by name. A controller is a function of one unit's row, called once a control period: it reads what is
sensed (`unit.worst_slip`, `unit.slipping`, `unit.coefficient_estimate`, ...) and `unit.torque_target`, and writes
`unit.torque_command`; both torques are positive in the direction of the demand. One of your own::

    def cautious(unit, axles, memory, run):
        unit.torque_command = 0.9 * unit.torque_target

    register("cautious", cautious, "a tenth less than asked for")

Under `alloc.onboard.signatures.control` the same function is compiled. Its parameters and memory are columns of a
`Table` of its own, of which `m = memory.view(ROW)[0]` is the unit's row; ROW is the table's `dtype`.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from difflib import get_close_matches
from typing import Any

import numpy as np
from numpy.typing import NDArray

from alloc.compilation import jit
from alloc.onboard.columns import NAN, ONE
from alloc.onboard.controllers import published as swarms
from alloc.onboard.controllers import search as searches
from alloc.onboard.controllers.search import ASSUMED, TUNED, lag_share, lasted, per_coefficient
from alloc.onboard.signatures import control
from alloc.schema.errors import OnboardError
from alloc.schema.registry import Registry
from alloc.schema.tables import Column, Table

NOTHING = Table("nothing")
"""Memory of a controller without one."""
ORDERED = (("lowest", "highest"), ("least", "largest"), ("cut", "recover"))
"""Pairs of parameters of which the first must not exceed the second."""


@dataclass(frozen=True, eq=False)
class Controller:
    """A readhesion controller."""

    name: str
    control: Callable[..., None]
    """Function `control(unit, axles, memory, run)`, see `alloc.onboard.signatures`."""
    meaning: str
    """One line."""
    memory: Table = NOTHING
    """Its parameters, which are the columns with a source, and what it remembers of a unit."""
    colour: str = "#555555"
    """Hexadecimal, the same in every figure."""
    marker: str = "o"
    """In figures, as Matplotlib names it."""
    bounds: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    """Least and greatest value of parameters; one that is not named must be above 0."""

    @property
    def settings(self) -> tuple[str, ...]:
        """Names of its parameters."""
        return tuple(key for key, column in self.memory.columns.items() if column.source)

    def tuned(self, **values: float) -> "Controller":
        """The same controller with other values of parameters; nothing is compiled anew.

        Raises `OnboardError` for a parameter that does not exist and for an impossible value.
        """
        columns = dict(self.memory.columns)
        for key, value in values.items():
            if key not in self.settings:
                near = get_close_matches(key, self.settings, 1)
                known = ", ".join(self.settings) or "it has none"
                hint = f"did you mean {near[0]!r}?" if near else f"parameters: {known}"
                raise OnboardError(f"{self.name}: unknown parameter {key!r}; {hint}")
            whole = isinstance(columns[key].default, int)
            low, high = self.bounds.get(key, (1e-12, math.inf))
            if not low <= value <= high or not math.isfinite(value) or (whole and value % 1 != 0):
                kind = "a whole number" if whole else "a number"
                raise OnboardError(
                    f"{self.name}: {key} = {value!r} must be {kind} from {low:g} to {high:g}"
                )
            columns[key] = replace(columns[key], default=int(value) if whole else float(value))
        for one, other in ORDERED:
            if {one, other} <= set(self.settings) and columns[one].default > columns[other].default:  # type: ignore[operator]
                raise OnboardError(f"{self.name}: {one} must not exceed {other}")
        return replace(self, memory=Table(self.memory.name, **columns))

    def rows(self, n: int) -> NDArray[np.float64]:
        """Memory of `n` units at the start of a run, (n, numbers)."""
        made: NDArray[np.float64] = np.asarray(self.memory.rows(n)).view(np.uint8)
        return made.view(np.float64).reshape(n, self.memory.dtype.itemsize // 8)


CONTROLLERS: Registry[Controller] = Registry("controller")
"""Readhesion controllers by name."""


def register(name: str, control: Callable[..., None], meaning: str, *about: Any) -> Controller:
    """Make a `Controller` (`about`: memory, colour, marker, bounds) and enter it in `CONTROLLERS`."""
    one = Controller(name, control, meaning, *about)
    return CONTROLLERS.register(name, one, control.__module__)


# Without a search


@control
def follow(unit, axles, memory, run):
    """The torque follows its target whatever the wheels do."""
    unit.torque_command = unit.torque_target


FOLLOW, CUT, HOLD, RAMP = range(4)
GIVEN_UP = 3.0
"""Time after which a cut that does not end the slip goes to no torque: the estimate was too high [s]."""

CUT_AND_RAMP = Table(
    "cut-and-ramp",
    cut=Column(0.3, ONE, "torque at a detection over what the rail carried", source=TUNED),
    recover=Column(1.0, ONE, "torque held after slip over what the rail carried", source=TUNED),
    hold=Column(0.1, "s", "time for which it is held", source=ASSUMED),
    ramp=Column(3.0, "s", "time in which the torque rises by the plan's", source=ASSUMED),
    phase=Column(FOLLOW, ONE, "0 follows, 1 cut, 2 holds, 3 ramps"),
    ticks=Column(0, ONE, "control periods in it"),
    carried=Column(0.0, "N m", "torque that the rail carried at the detection"),
)
CUT_AND_RAMP_ROW = CUT_AND_RAMP.dtype


@control
def cut_and_ramp(unit, axles, memory, run):
    """On slip the torque is cut to a part of what the observer says the rail carries, held, and raised again.

    After Kadowaki and Ohishi, who print no values. Slip in a later phase begins again with the new estimate.
    """
    m = memory.view(CUT_AND_RAMP_ROW)[0]
    scale, target = per_coefficient(unit), unit.torque_target
    m.ticks += 1
    if unit.slipping and m.phase != CUT:
        m.phase, m.ticks = CUT, 0
        # what the air brake takes of the rail's force is not the motors' to have
        rail = (unit.coefficient_estimate - unit.air / unit.load) * scale
        m.carried = min(max(rail, 0.0), target)
    elif m.phase == CUT and not unit.slipping:
        m.phase, m.ticks = HOLD, 0
    elif m.phase == HOLD and lasted(m.ticks, m.hold, run.period):
        m.phase = RAMP
    elif m.phase == RAMP and unit.torque_command >= target:
        m.phase = FOLLOW
    torque = target
    if m.phase == CUT:
        torque = 0.0 if lasted(m.ticks, GIVEN_UP, run.period) else m.cut * m.carried
    elif m.phase == HOLD:
        torque = m.recover * m.carried
    elif m.phase == RAMP:
        torque = unit.torque_command + run.plan * scale / m.ramp * run.period
    unit.torque_command = min(torque, target)


CALIBRATED = "calibrated in `studies.readhesion_paper`; the paper does not print it"
CASE_A = "readhesion paper, case A, read as km/h/s"

TORQUE_TABLE = Table(
    "table",
    margin=Column(0.4 / 3.6, "m s-2", "deviation a_0 up to which the factor is 1", source=CASE_A),
    width=Column(0.2 / 3.6, "m s-2", "deviation a_w over which it falls to 0", source=CASE_A),
    rise=Column(1.8, "s", "time constant T_u of a rising torque", source=CALIBRATED),
    fall=Column(0.25, "s", "time constant T_d of a falling torque", source=CALIBRATED),
    time_constant=Column(0.18, "s", "tau of the pseudo-differentiator", source=CALIBRATED),
    filtered=Column(NAN, "m s-1", "rim speed behind its filter"),
)
TORQUE_TABLE_ROW = TORQUE_TABLE.dtype


@jit
def torque_factor(deviation, margin, width):
    """Factor Adl of the readhesion paper's Fig. 5: 1 up to `margin`, 0 from `margin` + `width` on; all [m/s2]."""
    return min(max(1.0 - (deviation - margin) / width, 0.0), 1.0)


@jit
def asymmetric_lag(value, wanted, rise_share, fall_share):
    """A period of the filter behind the factor; the shares are `lag_share` of its time constants rising and falling."""
    return value + (rise_share if wanted > value else fall_share) * (wanted - value)


@control
def torque_table(unit, axles, memory, run):
    """A static table: torque factor over the deviation from the acceleration commanded (readhesion paper, section 2.3)."""
    m = memory.view(TORQUE_TABLE_ROW)[0]
    if math.isnan(m.filtered):
        m.filtered = unit.rim
    acceleration = (unit.rim - m.filtered) / m.time_constant
    m.filtered += lag_share(m.time_constant, run.period) * (unit.rim - m.filtered)
    deviation = run.sign * acceleration - abs(run.driver_command)
    wanted = torque_factor(deviation, m.margin, m.width) * unit.torque_target
    shares = lag_share(m.rise, run.period), lag_share(m.fall, run.period)
    filtered = asymmetric_lag(unit.torque_command, wanted, shares[0], shares[1])
    unit.torque_command = min(filtered, unit.torque_target)


# All, from the simplest on


NO_LESS_THAN_0 = (0.0, math.inf)
register("none", follow, "torque follows the limit whatever the wheels do", NOTHING, "#aa8e55", "o")
register(
    "table", torque_table, "torque factor by the deviation of acceleration (readhesion paper, section 2.3)",
    TORQUE_TABLE, "#c60055", "v", {"margin": NO_LESS_THAN_0},
)  # fmt: skip
register(
    "cut-and-ramp", cut_and_ramp, "cut on slip to what the observer says the rail carries, hold, ramp back",
    CUT_AND_RAMP, "#00aaaa", "s", {"cut": (0.0, 1.0), "recover": (0.0, 1.0), "hold": NO_LESS_THAN_0},
)  # fmt: skip
register(
    "pi-creep", searches.pi_creep, "a fixed slip velocity is held by PI control",
    searches.CREEP, "#aac655", "^",
)  # fmt: skip
register(
    "perturb-observe", searches.perturb_observe, "creep control whose reference climbs by fixed steps",
    searches.PERTURB, "#395539", "D",
)  # fmt: skip
register(
    "steepest-gradient", searches.steepest_gradient, "creep control whose reference climbs along the estimated slope",
    searches.STEEPEST, "#0000c6", "X",
)  # fmt: skip
register(
    "fuzzy-creep", searches.fuzzy_creep, "torque by fuzzy inference of slip and slip rate (Tian, Daniel, Meehan 2014)",
    searches.FUZZY_CREEP, "#55718e", "p",
)  # fmt: skip
register(
    "fuzzy-tracking", searches.fuzzy_tracking, "creep control whose reference climbs by inferred steps (arXiv 2406.13650)",
    searches.FUZZY_TRACKING, "#8e5500", "h",
)  # fmt: skip
register(
    "swarm-tracking", swarms.swarm_tracking, "creep control whose reference a particle swarm searches (arXiv 2406.13650)",
    swarms.SWARM_TRACKING, "#550039", "d", {"seed": NO_LESS_THAN_0},
)  # fmt: skip
register(
    "swarm-slip", swarms.swarm_slip, "PI control at the optimum slip of a swarm of curves (Zirek, Onat 2020)",
    swarms.SWARM_SLIP, "#390071", "8", {"seed": NO_LESS_THAN_0},
)  # fmt: skip
register(
    "cubature-seeking", searches.cubature_seeking, "extremum seeking on Kalman estimates (Applied Sciences 15, 10524)",
    searches.CUBATURE, "#550000", "H", {"lag": NO_LESS_THAN_0},
)  # fmt: skip
