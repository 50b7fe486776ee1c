"""The readhesion MPC of one unit as an object file, to be linked from C: what Numba compiles, with its memory built in.

In: a unit (`UnitContext`), its settings, and a processor out of `TARGETS`. Out (`export_unit`): object, header, README, and
what they were made from.

The control period is `mpc.unit`, its memory that of the solver and of the belief; see `alloc.object_file`.
"""

import json
from collections.abc import Sequence
from dataclasses import asdict
from typing import NamedTuple

import llvmlite.binding as llvm
import numpy as np

from alloc.object_file import TARGETS, Entry, object_file, vector
from alloc.onboard.host import ANSWER, READING, UnitContext
from alloc.sources import code_hash, library_versions
from mpc.belief import with_predicted_curve
from mpc.generated import compiled_model
from mpc.model import unit_model
from mpc.settings import MpcError, MpcSettings
from mpc.solver import Addresses
from mpc.unit import STATUSES, compiled_unit, unit_step

READ = {
    "time": "[s]; not used",
    "speed": "reference speed of the car [m/s]",
    "torque": "of each motor, as the inverter knows it [N m]",
    "target": "torque wanted of each motor [N m]; driving is positive, braking negative",
    "drive_limit": "greatest torque of each motor when driving [N m]",
    "brake_limit": "the same when braking [N m]",
    "coefficient": "tangential force coefficient that the unit estimates; nan if it does not",
    "slipping": "signal of a slip detector; not used",
}
ANSWERED = {
    "torque": "command for each motor [N m]; if it is usable",
    "solve_time": "time that the steps count as [s]",
    "residual": "of optimality; nan without a solution",
    "usable": "1, or 0: the drive must use its own reserve, such as cut and ramp",
    "status": "one of ControllerStatus",
}


class ExportedController(NamedTuple):
    """A controller to be linked."""

    contents: dict[str, bytes]
    """Content of each file, by its name."""
    memory: int
    """Bytes of static memory that is written to."""


def export_unit(
    context: UnitContext,
    settings: MpcSettings | None = None,
    target: str = "x86-64",
    name: str = "",
) -> ExportedController:
    """The controller of a unit as an object file for a processor; `name` tells the reader which unit it is.

    Raises `MpcError` for a processor that is none of `TARGETS`.
    """
    if target not in TARGETS:
        raise MpcError(
            f"export: target = {target!r} must be one of {', '.join(TARGETS)}: the controller has addresses of 64 bits, "
            "and numbers whose lowest byte comes first"
        )
    settings = settings or MpcSettings()
    controller = compiled_unit(context, settings)  # kept: it owns the memory that is read here
    record = controller.kept[0]
    model = compiled_model(unit_model(with_predicted_curve(context)))
    addresses = record.problem.solver.model
    others = {getattr(addresses, name): getattr(model, name) for name in Addresses._fields}
    omega = [f"%omega = getelementptr i8, ptr %reading, i64 {READING.itemsize}"]
    arguments = (
        "i64 ptrtoint (ptr @record to i64)",
        "ptr %reading",
        *vector("%omega", context.axles),
        "ptr %answer",
    )
    entry = Entry("controller", "ptr %reading, ptr %answer", omega, arguments)
    made = object_file(entry, unit_step, record, others, target)
    contents = {
        "controller.o": made.code,
        "controller.h": _header(context, made.memory, name).encode(),
        "README": _readme(name, target, made.calls).encode(),
        "made-from.json": _made_from(context, settings, name, target).encode(),
    }
    return ExportedController(contents, made.memory)


def _title(name: str) -> str:
    return f"Readhesion MPC of one unit{f', {name}' if name else ''}."


def _structure(name: str, kind: np.dtype, meanings: dict[str, str], *more: str) -> list[str]:
    types = {"f": "double", "i": "int64_t"}
    fields = [f"  {types[kind[one].kind]} {one}; /* {meanings[one]} */" for one in kind.names or ()]
    return ["typedef struct {", *fields, *more, f"}} {name};", ""]


def _header(context: UnitContext, memory: int, name: str) -> str:
    omega = "  double omega[CONTROLLER_AXLES]; /* angular speed of each wheelset [rad/s] */"
    lines = [
        f"/* {_title(name)} Written by readhesion; do not edit. */", "",
        "#ifndef CONTROLLER_H", "#define CONTROLLER_H", "", "#include <stdint.h>", "",
        "#ifdef __cplusplus", 'extern "C" {', "#endif", "",
        f"#define CONTROLLER_AXLES {context.axles}",
        f"#define CONTROLLER_PERIOD {context.period!r} /* [s], from one call of controller_step to the next */",
        f"#define CONTROLLER_MEMORY {memory} /* bytes of static memory that is written to */", "",
        "/* What the unit reads. */", *_structure("ControllerReading", READING, READ, omega),
        "/* What it is to do. */", *_structure("ControllerAnswer", ANSWER, ANSWERED),
        "typedef enum {", *(f"  CONTROLLER_{one.upper().replace(' ', '_')}," for one in STATUSES),
        "} ControllerStatus;", "",
        "/* Once, before the first step, and to start anew. */", "void controller_init(void);", "",
        "/* A control period. */",
        "void controller_step(const ControllerReading *reading, ControllerAnswer *answer);", "",
        "#ifdef __cplusplus", "}", "#endif", "", "#endif",
    ]  # fmt: skip
    return "\n".join(lines) + "\n"


def _readme(name: str, target: str, linked: Sequence[str]) -> str:
    return f"""{_title(name)} Written by readhesion for {target}; see made-from.json for settings and versions.
Call controller_init once, then controller_step every CONTROLLER_PERIOD; controller.h says what goes in and out.
Link: cc main.c controller.o -lm. The object (ELF, System V ABI) calls {", ".join(linked)}, and nothing else.
It allocates nothing.
All memory is static: CONTROLLER_MEMORY bytes, and a stack. So there is one controller, and one thread may call it.
Another unit is another object; objcopy --redefine-sym controller_step=NEW gives it names of its own.
Where an answer is not usable, the drive must fall back on a reserve of its own; a reading that is no number leads to that.
"""


def _made_from(context: UnitContext, settings: MpcSettings, name: str, target: str) -> str:
    left_out = ("settings", "telegrams", "curve")
    unit = {one: value for one, value in asdict(context).items() if one not in left_out}
    made = {
        "unit": {"name": name, **unit},
        "settings": asdict(settings),
        "target": target,
        "sources": code_hash(__name__, later=False),
        "versions": {**library_versions(), "llvm": "{}.{}.{}".format(*llvm.llvm_version_info)},
    }
    return json.dumps(made, indent=2) + "\n"
