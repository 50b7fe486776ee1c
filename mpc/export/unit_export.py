"""The readhesion MPC of one unit as C99: the source files, their memory, and what they were made from."""

import json
from dataclasses import asdict
from typing import Any, NamedTuple

from alloc.onboard.compiled_controller import ANSWER, READING
from alloc.onboard.host import UnitContext
from alloc.sources import library_versions, syntax_hash
from mpc.belief import with_predicted_curve
from mpc.compiled_model import CompiledModel, compiled_model
from mpc.export import c_known as known
from mpc.export.c_kinds import DOUBLE, Array, Record, Several, Value, number_text
from mpc.export.c_memory import Memory
from mpc.export.c_program import Instance, Program, structure
from mpc.settings import MpcSettings
from mpc.sqp_period import Addresses
from mpc.unit_model import unit_model
from mpc.unit_step import (
    STATUSES,
    UnitState,
    compiled_unit,
    state_at,
    unit_feedback,
    unit_preparation,
    unit_step,
)

_FIELDS = {
    "time": "[s]; not used",
    "speed": "reference speed of the car [m/s]",
    "torque": "of each motor, as the inverter knows it [N m]",
    "target": "torque wanted of each motor [N m]; driving is positive, braking negative",
    "drive_limit": "greatest torque of each motor when driving [N m]",
    "brake_limit": "the same when braking [N m]",
    "coefficient": "tangential force coefficient that the unit estimates; nan if it does not",
    "slipping": "signal of a slip detector; not used",
}
_ANSWERED = {
    "torque": "command for each motor [N m]; if it is usable",
    "solve_time": "time that the steps count as [s]",
    "residual": "of optimality; nan without a solution",
    "usable": "1, or 0: the drive must use its own reserve, such as cut and ramp",
    "status": "one of ControllerStatus",
}


class ExportedController(NamedTuple):
    """A controller in C."""

    contents: dict[str, str]
    """Text of each file, by its name."""
    memory: int
    """Bytes of static memory."""


def export_unit(
    context: UnitContext, settings: MpcSettings | None = None, name: str = ""
) -> ExportedController:
    """The controller of a unit in C; `name` tells the reader which unit it is.

    Raises `mpc.export.c_kinds.TranslationError` where the controller contains a construct without a translation.
    """
    settings = settings or MpcSettings()
    record = compiled_unit(context, settings).kept[0]
    model = compiled_model(unit_model(with_predicted_curve(context)))
    state = _with_functions(UnitState(*(getattr(record, one) for one in UnitState._fields)), model)
    program = Program({state_at: Value(Record("memory", state))})
    reading = Value(structure("const ControllerReading", READING), "reading")
    answer = Value(structure("ControllerAnswer", ANSWER), "answer")
    omega = Value(Array(DOUBLE, (context.axles,)), "omega", (str(context.axles),))
    nothing = Value(Record("address", None))
    first = program.first(unit_step, [nothing, reading, omega, answer])
    phases = [
        program.first(unit_feedback, [nothing, reading, omega, answer]),
        program.first(unit_preparation, [nothing]),
    ]
    functions, uses = program.reached(first)
    memory = Memory(state, uses["field"])
    parts = [
        [f"/* {_title(name)} Written by readhesion; do not edit. */", ""],
        ['#include "controller.h"', "", "#include <math.h>", "#include <stdbool.h>", ""],
        *(_tuple(one) for one in sorted(uses.get("tuple", ()), key=lambda one: one.name)),
        *(_structure(one) for one in memory.structures),
        [
            f"/* {memory.size} bytes, all of the memory that is written to. */",
            *memory.declaration(),
            "",
        ],
        _constants(program, uses),
        *([*f"static {known.HELPERS[one]}".split("\n"), ""] for one in _helpers(uses)),
        *([*one.lines, ""] for one in functions),
        _start(memory),
        _entries(first, phases if settings.phases_apart else []),
    ]
    code = "\n".join(line.rstrip() for part in parts for line in part) + "\n"
    contents = {
        "controller.h": _header(context, memory, name, settings.phases_apart),
        "controller.c": code,
        "README": _readme(name),
        "made-from.json": _made_from(context, settings, name),
    }
    return ExportedController(contents, memory.size)


def _with_functions(state: UnitState, model: CompiledModel) -> UnitState:
    """The state, with the model's functions in place of their addresses."""
    addresses: Any = (
        model.prepare, model.slope, model.rate, model.tangent,
    )  # fmt: skip
    solver = state.problem.solver._replace(model=Addresses(*addresses))
    return state._replace(problem=state.problem._replace(solver=solver))


def _title(name: str) -> str:
    return f"Readhesion MPC of one unit{f', {name}' if name else ''}."


def _tuple(kind: Several) -> list[str]:
    fields = [f"  {item.name} item{k};" for k, item in enumerate(kind.items)]
    return ["typedef struct {", *fields, f"}} {kind.name};", ""]


def _structure(kind: Any) -> list[str]:
    return [
        "typedef struct {",
        *(f"  {of.name} {name};" for name, of in kind.fields),
        f"}} {kind.name};",
        "",
    ]


def _constants(program: Program, uses: dict[str, set[Any]]) -> list[str]:
    names = sorted(uses.get("constant", ()))
    return [
        *(f"static const double {one} = {number_text(program.constants[one])};" for one in names),
        "",
    ]


def _helpers(uses: dict[str, set[Any]]) -> list[str]:
    return [one for one in known.HELPERS if one in uses.get("helper", ())]


def _start(memory: Memory) -> list[str]:
    constants, lines = memory.filling()
    text = "\n".join(lines)
    made = []
    for of, kind in (("", "double"), ("_whole", "int64_t")):
        if f"fill{of}(" in text:
            made += [
                f"static void fill{of}({kind} *to, int64_t size, {kind} value)", "{",
                "  for (int64_t i = 0; i < size; i++) to[i] = value;", "}", "",
            ]  # fmt: skip
        if f"copy{of}(" in text:
            made += [
                f"static void copy{of}({kind} *to, int64_t size, const {kind} *from)", "{",
                "  for (int64_t i = 0; i < size; i++) to[i] = from[i];", "}", "",
            ]  # fmt: skip
    return [*constants, "", *made, "void controller_init(void)", "{", *lines, "}", ""]


_FEEDBACK = "void controller_feedback(const ControllerReading *reading, ControllerAnswer *answer)"
_PREPARE = "void controller_prepare(void)"
_STEP = "void controller_step(const ControllerReading *reading, ControllerAnswer *answer)"


def _entries(whole: Instance, phases: list[Instance]) -> list[str]:
    """What the header declares; `phases`: feedback and preparation, if each is to be called for itself."""
    lines = ["typedef char memory_is_as_stated[sizeof memory == CONTROLLER_MEMORY ? 1 : -1];"]
    for head, of in zip((_STEP, _FEEDBACK, _PREPARE), (whole, *phases), strict=False):
        lines += ["", head, "{"]
        if "omega" in of.parameters:
            lines += [
                "  double omega[CONTROLLER_AXLES];",
                "  for (int64_t i = 0; i < CONTROLLER_AXLES; i++) omega[i] = reading->omega[i];",
            ]
        lines += [f"  {of.name}({', '.join(of.parameters)});", "}"]
    return lines


def _phases() -> list[str]:
    return [
        "", "/* Or its two phases, each by a call: on the readings, and once the command is out. */",
        f"{_FEEDBACK};", f"{_PREPARE};",
    ]  # fmt: skip


def _header(context: UnitContext, memory: Memory, name: str, apart: bool) -> str:
    read = structure("ControllerReading", READING).fields
    answered = structure("ControllerAnswer", ANSWER).fields
    status = [f"  CONTROLLER_{one.upper().replace(' ', '_')}," for one in STATUSES]
    lines = [
        f"/* {_title(name)} Written by readhesion; do not edit. */", "",
        "#ifndef CONTROLLER_H", "#define CONTROLLER_H", "", "#include <stdint.h>", "",
        "#ifdef __cplusplus", 'extern "C" {', "#endif", "",
        f"#define CONTROLLER_AXLES {context.axles}",
        f"#define CONTROLLER_PERIOD {context.period!r} /* [s], from one call of controller_step to the next */",
        f"/* Bytes of static memory that is written to; {memory.starts} more are constants that it starts from. */",
        f"#define CONTROLLER_MEMORY {memory.size}", "",
        "/* What the unit reads. */", "typedef struct {",
        *(f"  {kind.name} {one}; /* {_FIELDS[one]} */" for one, kind in read),
        "  double omega[CONTROLLER_AXLES]; /* angular speed of each wheelset [rad/s] */",
        "} ControllerReading;", "",
        "/* What it is to do. */", "typedef struct {",
        *(f"  {kind.name} {one}; /* {_ANSWERED[one]} */" for one, kind in answered),
        "} ControllerAnswer;", "",
        "typedef enum {", *status, "} ControllerStatus;", "",
        "/* Once, before the first step, and to start anew. */", "void controller_init(void);", "",
        "/* A control period. */", f"{_STEP};", *(_phases() if apart else []), "",
        "#ifdef __cplusplus", "}", "#endif", "", "#endif",
    ]  # fmt: skip
    return "\n".join(lines) + "\n"


def _readme(name: str) -> str:
    return f"""{_title(name)} Written by readhesion; see made-from.json for settings and versions.
Call controller_init once, then controller_step every CONTROLLER_PERIOD; controller.h says what goes in and out.
Compile: cc -std=c99 -O2 -c controller.c; link with -lm. Of the libraries it needs math.h alone, and it allocates nothing.
All memory is static: CONTROLLER_MEMORY bytes, and a stack. So there is one controller, and one thread may call it.
Where an answer is not usable, the drive must fall back on a reserve of its own; a reading that is no number leads to that.
"""


def _made_from(context: UnitContext, settings: MpcSettings, name: str) -> str:
    unit = {
        one: value
        for one, value in asdict(context).items()
        if one not in ("settings", "telegrams", "curve")
    }
    made = {
        "unit": {"name": name, **unit},
        "settings": asdict(settings),
        "sources": syntax_hash(__name__, later=False)[:16],
        "versions": library_versions(),
    }
    return json.dumps(made, indent=2) + "\n"
