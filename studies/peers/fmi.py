"""Units of FMI 3.0 for co-simulation: the plant of a scenario, and the readhesion MPC of one of its traction units.

In: a scenario. Out: a file (`.fmu`) for Simulink, Simpack, FMPy and others, whose binary needs no Python: the object that
`alloc.object_file` makes of the compiled plant, or `mpc.export` of the controller, linked with the interface of the standard
in C. To make one takes Linux, a C compiler, and the extra `fmi`, whose FMPy has the standard's headers. To run one takes
neither.

Memory is static, so a process has one instance of a unit, and its state cannot be saved and restored.
"""

import hashlib
import platform
import re
import shutil
import subprocess
import tempfile
import zipfile
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple
from xml.sax.saxutils import quoteattr

from numba import float64, int64

from alloc.compilation import jit
from alloc.event import Event
from alloc.loop import ClosedLoop
from alloc.object_file import Entry, object_file, vector
from alloc.onboard.host import ANSWER, READING, unit_contexts
from alloc.plant.engine import derivative, inlined_advance, pack
from alloc.plant.model import Floats, Inputs
from alloc.plant.operations import WIDTH
from alloc.plant.rail import read_rail
from alloc.recording import VARIABLES
from alloc.records import ByReference, meant
from mpc.export import ANSWERED, READ, export_unit
from studies.files.study_error import StudyError
from studies.scenario.scenario import Scenario, safe_name

MACHINES = {"x86_64": "x86-64", "aarch64": "aarch64"}
"""Target of `alloc.object_file` by the name that the standard and Python have for a processor."""
COMPILERS = ("cc", "gcc", "clang")
LONGEST = 120.0
"""Seconds that a compiler may take."""


class Variable(NamedTuple):
    """A number that goes in or out."""

    name: str
    unit: str
    meaning: str


class CoSimulation(NamedTuple):
    """What a unit of FMI is made from."""

    name: str
    """Letters, digits and underscores."""
    description: str
    inputs: tuple[Variable, ...]
    outputs: tuple[Variable, ...]
    step: float
    """Communication steps are whole multiples of this [s]."""
    duration: float
    """Of the scenario [s]."""
    files: dict[str, bytes]
    """An object and headers to be linked."""
    glue: str
    """C: `start()`, and `advance(time, steps, given, found)` from the inputs to the outputs at the end; see `_INTERFACE`."""


# The plant.


class PlantMemory(NamedTuple):
    """All that a plant on its way needs."""

    step: float
    """Integration step [s]."""
    state: Floats
    inputs: Inputs
    workspace: ByReference


@jit
def plant_step(p, time, steps, given, found):
    """Advance the plant by so many integration steps from `time` [s] with the inputs `given`, and fill `found` at the end.

    `given`: the fields of `Inputs` one after the other. `found`: those of `_plant_outputs`.
    """
    w = p.workspace
    n, row, c = w.size, w.row, w.scratch
    k = 0
    for values in (
        p.inputs.torque_command,
        p.inputs.pressure_target,
        p.inputs.valve,
        p.inputs.sand_rate,
    ):
        for j in range(values.size):
            values[j] = given[k]
            k += 1
    inlined_advance(w, time, p.step, steps, p.state, p.inputs)
    # forces and accelerations at the end, with which the next step starts
    pack(w, p.state, c.state)
    read_rail(w)
    derivative(w, time + steps * p.step, c.state, c.slope)
    found[0] = c.state[row.position]
    k = 1
    for b in range(n.bodies):
        found[k + b] = c.state[row.speed + b]
        found[k + n.bodies + b] = c.slope[row.speed + b]
    k += 2 * n.bodies
    for i in range(n.axles):
        found[k + i] = w.axle.radius[i] * c.state[row.omega + i]
        found[k + n.axles + i] = c.force[i]
        found[k + 2 * n.axles + i] = c.normal[i]
    k += 3 * n.axles
    for j in range(n.units):
        found[k + j] = c.state[row.torque + j]
    k += n.units
    for g in range(n.groups):
        found[k + g] = c.state[row.pressure + g]
    k += n.groups
    for b in range(n.bodies - 1):
        found[k + b] = c.tension[WIDTH + b]


def _numbered(count: int, name: str, unit: str, meaning: str) -> Iterator[Variable]:
    """One variable per axle, unit, brake group or other part, numbered from 1, foremost first."""
    yield from (Variable(f"{name}[{k + 1}]", unit, meaning) for k in range(count))


def _alone(name: str) -> Variable:
    """A variable of recorded runs, of which there is one."""
    recorded = VARIABLES[name]
    return Variable(
        name,
        re.sub(r" s-([12])", lambda found: "/s" + found[1].removeprefix("1"), recorded.units),
        recorded.long_name,
    )


def _recorded(count: int, name: str) -> Iterator[Variable]:
    """As `_numbered`, of a variable of recorded runs."""
    yield from _numbered(count, *_alone(name))


def plant_of(scenario: Scenario, seed: int = 0) -> CoSimulation:
    """The train on its rail, without any computer on board, as it stands when the event begins.

    Inputs hold over a communication step. Outputs are those at its end; their names are those of recorded runs, `car_speed`
    where cars move apart.
    """
    event = scenario.event(seed)
    n, record = event.model.layout, _plant_memory(event)
    inputs = (
        *_numbered(n.units, "torque_command", "N m", "torque of each motor of the unit"),
        *_numbered(n.groups, "pressure_target", "Pa", "pressure wanted in the brake cylinder"),
        *_numbered(n.groups, "valve", "1", "0 follows the target, 1 holds, 2 releases"),
        *_numbered(n.sanders, "sand_rate", "kg/s", "sand laid on each rail"),
    )
    moving = "speed", "acceleration"
    outputs = (
        _alone("position"),
        *(one for name in moving for one in ([_alone(name)] if n.bodies == 1 else _recorded(n.bodies, f"car_{name}"))),
        *(one for name in ("rim_speed", "rail_force", "axle_load") for one in _recorded(n.axles, name)),
        *_recorded(n.units, "motor_torque"),
        *_recorded(n.groups, "cylinder_pressure"),
        *_recorded(n.bodies - 1, "coupler_force"),
    )  # fmt: skip
    plant_step.compile((record.kind, float64, int64, float64[::1], float64[::1]))
    arguments = (
        "ptr @record", "double %time", "i64 %steps",
        *vector("%given", len(inputs)), *vector("%found", len(outputs)),
    )  # fmt: skip
    parameters = "double %time, i64 %steps, ptr %given, ptr %found"
    made = object_file(
        Entry("plant", parameters, (), arguments), plant_step, record, {}, _machine()
    )
    return CoSimulation(
        f"{_identifier(scenario.name)}_plant",
        f"Train and rail of the scenario {scenario.name}, seed {seed}",
        inputs, outputs, record.step, event.duration, {"plant.o": made.code},
        """
void plant_init(void);
void plant_step(double time, int64_t steps, const double *given, double *found);
static void start(void) { plant_init(); }
static void advance(double time, int64_t steps, const double *given, double *found)
{
  plant_step(time, steps, given, found);
}
""",
    )  # fmt: skip


def _plant_memory(event: Event) -> ByReference:
    """The plant at the start of an event, with the integration step of its runs."""
    loop = ClosedLoop(
        event.model, 1, event.onboard.period, event.longest_step, event.record_period,
        event.initial_speed, event.initial_position,
    )  # fmt: skip
    plant = loop.plant
    return ByReference(PlantMemory(loop.timing.step, plant.state, plant.inputs, plant.workspace))


# The controller.


def controller_of(scenario: Scenario, unit: int) -> CoSimulation:
    """The readhesion MPC of a unit, numbered from 1, with the scenario's settings; inputs are read when a step begins.

    A communication step is one control period, or several with the same readings.
    """
    event = scenario.event()
    context = unit_contexts(event.model, event.equipment, event.onboard, "mpc")[unit - 1]
    made = export_unit(context, context.settings, _machine(), f"unit {unit} of {scenario.name}")
    read = [name for name in READING.names or () if name != "time"]
    answered = list(ANSWER.names or ())
    names = {"torque": "torque_command"}  # one that is read has its name too
    kinds = {name: "(int64_t)" if READING[name].kind == "i" else "" for name in read}
    values = [f"{kinds[name]}given[{k}]" for k, name in enumerate(read)]
    omega = ", ".join(f"given[{len(read) + i}]" for i in range(context.axles))
    return CoSimulation(
        f"{_identifier(scenario.name)}_controller_{unit}",
        f"Readhesion MPC of unit {unit} of the scenario {scenario.name}",
        (
            *(_told(name, READ[name]) for name in read),
            *_numbered(context.axles, "omega", "rad/s", "angular speed of the wheelset"),
        ),
        tuple(_told(names.get(name, name), ANSWERED[name]) for name in answered),
        context.period,
        event.duration,
        {name: made.contents[name] for name in ("controller.o", "controller.h")},
        f"""
#include "controller.h"
static void start(void) {{ controller_init(); }}
static void advance(double time, int64_t steps, const double *given, double *found)
{{
  ControllerReading reading = {{time, {", ".join(values)}, {{{omega}}}}};
  ControllerAnswer answer;
  for (; steps > 0; steps--) {{
    controller_step(&reading, &answer);
    {" ".join(f"found[{k}] = (double)answer.{name};" for k, name in enumerate(answered))}
  }}
}}
""",
    )


def _told(name: str, text: str) -> Variable:
    meaning = meant(text)
    return Variable(name, meaning.unit or "1", meaning.text)


# The file: description, and the standard's interface, linked with the object.


def write_fmu(made: CoSimulation, path: Path) -> None:
    """Link the binary, and pack it with its description; raises `StudyError` where that cannot be done here."""
    with tempfile.TemporaryDirectory() as place, zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:  # fmt: skip
        binary = _linked(made, Path(place))
        archive.writestr("modelDescription.xml", _description(made))
        archive.write(binary, f"binaries/{platform.machine()}-linux/{made.name}.so")


def _linked(made: CoSimulation, folder: Path) -> Path:
    """The shared library."""
    compiler = next(filter(None, map(shutil.which, COMPILERS)), None)
    if compiler is None:
        raise StudyError(
            f"to link a unit of FMI needs a C compiler; install one of {', '.join(COMPILERS)}"
        )
    headers = _headers()
    for name, content in made.files.items():
        (folder / name).write_bytes(content)
    (folder / "unit.c").write_text(_interface(made, headers))
    command = [
        compiler, "-std=c99", "-O2", "-shared", "-fPIC", "-Wl,-Bsymbolic", f"-I{headers}", "unit.c",
        *(name for name in made.files if name.endswith(".o")), "-lm", "-o", "unit.so",
    ]  # fmt: skip
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=LONGEST)
    if done.returncode:
        raise StudyError(f"{compiler} cannot link a unit of FMI: {done.stderr}")
    return folder / "unit.so"


def _machine() -> str:
    """Target of `alloc.object_file` for this machine."""
    if platform.system() != "Linux" or platform.machine() not in MACHINES:
        raise StudyError(
            f"units of FMI are made on Linux ({' or '.join(MACHINES)}), not on {platform.system()} {platform.machine()}"
        )
    return MACHINES[platform.machine()]


def _headers() -> Path:
    """Folder of the standard's headers, which FMPy brings."""
    found = find_spec("fmpy")
    if found is None or found.origin is None:
        raise StudyError(
            "units of FMI need the package fmpy; install it with `pip install -e '.[fmi]'`"
        )
    return Path(found.origin).parent / "c-code"


def _identifier(name: str) -> str:
    return re.sub(r"\W", "_", safe_name(name))


def _token(made: CoSimulation) -> str:
    """By which an importer sees that description and binary belong together."""
    parts = (made.glue, *map(str, (*made.inputs, *made.outputs)), made.name, repr(made.step))
    digest = hashlib.sha256("\n".join(parts).encode())
    for content in made.files.values():
        digest.update(content)
    return digest.hexdigest()[:32]


def _unit(one: Variable) -> str:
    """As the standard writes units: a point is a product."""
    return one.unit.replace(" ", ".")


def _description(made: CoSimulation) -> str:
    """`modelDescription.xml`; variables are numbers of their own, named as elements of arrays are in Modelica."""
    lines, references = list[str](), range(1, 1 + len(made.inputs) + len(made.outputs))
    for k, one in zip(references, (*made.inputs, *made.outputs), strict=True):
        kind = 'causality="input" start="0"' if k <= len(made.inputs) else 'causality="output"'
        lines.append(
            f'    <Float64 name={quoteattr(one.name)} valueReference="{k}" {kind} unit={quoteattr(_unit(one))} '
            f"description={quoteattr(one.meaning)}/>"
        )
    units = sorted({_unit(one) for one in (*made.inputs, *made.outputs)} | {"s"})
    outputs = references[len(made.inputs) :]
    return "\n".join([
        '<?xml version="1.0" encoding="UTF-8"?>',
        f'<fmiModelDescription fmiVersion="3.0" modelName="{made.name}" description={quoteattr(made.description)} '
        f'instantiationToken="{_token(made)}" generationTool="readhesion" variableNamingConvention="structured">',
        f'  <CoSimulation modelIdentifier="{made.name}" canHandleVariableCommunicationStepSize="true" '
        f'fixedInternalStepSize="{made.step!r}" canBeInstantiatedOnlyOncePerProcess="true"/>',
        "  <UnitDefinitions>", *(f"    <Unit name={quoteattr(one)}/>" for one in units), "  </UnitDefinitions>",
        f'  <DefaultExperiment startTime="0" stopTime="{made.duration!r}" stepSize="{made.step!r}"/>',
        "  <ModelVariables>",
        '    <Float64 name="time" valueReference="0" causality="independent" unit="s" description="time"/>',
        *lines, "  </ModelVariables>", "  <ModelStructure>",
        *(f'    <Output valueReference="{k}"/>' for k in outputs),
        *(f'    <InitialUnknown valueReference="{k}"/>' for k in outputs),
        "  </ModelStructure>", "</fmiModelDescription>", "",
    ])  # fmt: skip


_INTERFACE = r"""
static double value[1 + INPUTS + OUTPUTS]; /* the time, what is given, what is found */
static int instances;
static fmi3InstanceEnvironment environment;
static fmi3LogMessageCallback logged;

static fmi3Status refused(const char *message)
{
  if (logged) logged(environment, fmi3Error, "logStatusError", message);
  return fmi3Error;
}
static void find(int64_t steps) { advance(value[0], steps, value + 1, value + 1 + INPUTS); }

const char *fmi3GetVersion(void) { return fmi3Version; }
fmi3Instance fmi3InstantiateCoSimulation(
  fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible, fmi3Boolean logging, fmi3Boolean events,
  fmi3Boolean early, const fmi3ValueReference intermediate[], size_t n, fmi3InstanceEnvironment its,
  fmi3LogMessageCallback log, fmi3IntermediateUpdateCallback update)
{
  (void)name, (void)resources, (void)visible, (void)logging, (void)events, (void)early, (void)intermediate, (void)n;
  (void)update;
  environment = its, logged = log;
  if (strcmp(token, TOKEN)) { refused("binary and description do not belong together"); return NULL; }
  if (instances) { refused("a process can have one instance of this unit"); return NULL; }
  instances = 1;
  fmi3Reset(value);
  return value;
}
void fmi3FreeInstance(fmi3Instance instance) { if (instance) instances = 0; }
fmi3Status fmi3Reset(fmi3Instance instance)
{
  (void)instance;
  memset(value, 0, sizeof value);
  start();
  return fmi3OK;
}
fmi3Status fmi3EnterInitializationMode(
  fmi3Instance instance, fmi3Boolean defined, fmi3Float64 tolerance, fmi3Float64 begin, fmi3Boolean ends, fmi3Float64 end)
{
  (void)instance, (void)defined, (void)tolerance, (void)ends, (void)end;
  value[0] = begin;
  find(0);
  return fmi3OK;
}
fmi3Status fmi3ExitInitializationMode(fmi3Instance instance) { (void)instance; find(0); return fmi3OK; }
fmi3Status fmi3EnterStepMode(fmi3Instance instance) { (void)instance; return fmi3OK; }
fmi3Status fmi3Terminate(fmi3Instance instance) { (void)instance; return fmi3OK; }
fmi3Status fmi3SetDebugLogging(fmi3Instance instance, fmi3Boolean on, size_t n, const fmi3String categories[])
{
  (void)instance, (void)on, (void)n, (void)categories;
  return fmi3OK;
}
fmi3Status fmi3GetFloat64(
  fmi3Instance instance, const fmi3ValueReference places[], size_t n, fmi3Float64 values[], size_t size)
{
  (void)instance;
  if (n != size) return refused("as many values as variables are read");
  for (size_t k = 0; k < n; k++) {
    if (places[k] > INPUTS + OUTPUTS) return refused("there is no variable of this number");
    values[k] = value[places[k]];
  }
  return fmi3OK;
}
fmi3Status fmi3SetFloat64(
  fmi3Instance instance, const fmi3ValueReference places[], size_t n, const fmi3Float64 values[], size_t size)
{
  (void)instance;
  if (n != size) return refused("as many values as variables are set");
  for (size_t k = 0; k < n; k++) {
    if (places[k] < 1 || places[k] > INPUTS) return refused("only inputs are set");
    value[places[k]] = values[k];
  }
  return fmi3OK;
}
fmi3Status fmi3DoStep(
  fmi3Instance instance, fmi3Float64 time, fmi3Float64 length, fmi3Boolean no_return, fmi3Boolean *event,
  fmi3Boolean *ended, fmi3Boolean *early, fmi3Float64 *reached)
{
  double steps = floor(length / STEP + 0.5);
  (void)instance, (void)no_return;
  *event = *ended = *early = fmi3False;
  *reached = time;
  if (!(steps >= 1.0 && fabs(steps * STEP - length) <= 1e-6 * STEP * steps))
    return refused("the communication step must be a whole multiple of fixedInternalStepSize");
  value[0] = time;
  find((int64_t)steps);
  *reached = value[0] = time + length;
  return fmi3OK;
}
"""


def _interface(made: CoSimulation, headers: Path) -> str:
    """The C of the unit; what it does not offer answers with an error, as the standard asks."""
    types = (headers / "fmi3FunctionTypes.h").read_text(encoding="utf-8")
    declared = re.findall(
        r"^typedef\s+([\w ]+?\*?)\s*(fmi3\w+)TYPE\s*\((.*?)\);", types, re.M | re.S
    )
    offered = set(re.findall(r"\b(fmi3\w+)\(", _INTERFACE))
    others = [
        f"{kind} {name}({parameters}) {{ {'return NULL;' if 'Instance' in kind else 'return fmi3Error;'} }}"
        for kind, name, parameters in declared
        if name not in offered
    ]
    return "\n".join([
        "#include <math.h>", "#include <stdint.h>", "#include <string.h>", '#include "fmi3Functions.h"',
        f'#define TOKEN "{_token(made)}"', f"#define STEP {made.step!r}",
        f"#define INPUTS {len(made.inputs)}", f"#define OUTPUTS {len(made.outputs)}",
        made.glue, _INTERFACE, *others, "",
    ])  # fmt: skip
