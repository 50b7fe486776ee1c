"""The readhesion MPC of one unit as an object file, to be linked from C: what Numba compiles, with its memory built in.

In: a unit (`UnitContext`), its settings, and a processor out of `TARGETS`. Out (`export_unit`): object, header, README, and
what they were made from.

Numba has optimised the functions of a control period (`mpc.unit`) already. LLVM gets them once more here, together with
the record that they read. Every array becomes static memory; every number of the settings and every address a constant. So
calls by address become plain calls, branches that the settings exclude vanish, and nothing is left to be looked up at the
start. No multiplication and addition are rounded as one (FMA). So every processor answers with the same bits, if its
mathematical library does, and they are those of Numba on a processor without FMA.
"""

import json
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from itertools import pairwise
from typing import Any, NamedTuple

import llvmlite.binding as llvm
import numpy as np

from alloc.onboard.host import ANSWER, READING, UnitContext
from alloc.records import ByReference
from alloc.sources import code_hash, library_versions
from mpc.belief import with_predicted_curve
from mpc.generated import compiled_model
from mpc.model import unit_model
from mpc.settings import MpcError, MpcSettings
from mpc.solver import Addresses
from mpc.unit import STATUSES, compiled_unit, unit_step

TARGETS = {
    **{f"x86-64{level}": ("x86_64", f"x86-64{level}") for level in ("", "-v2", "-v3", "-v4")},
    "aarch64": ("aarch64", ""),
}
"""Processors by name: architecture and processor in LLVM's words. Levels of x86-64: those of its System V ABI."""

LINKED = ("atan", "ceil", "cos", "exp", "floor", "fmod", "log", "memcpy", "memmove", "memset", "sin", "sqrt")  # fmt: skip
"""What the object may call: mathematics, and what C compilers call by themselves."""

_LINE = 64
"""Bytes to which every array is aligned: a cache line."""

_READ = {
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
    machine = _machine(*TARGETS[target])
    module = _joined(context, settings, machine)
    _specialise(module, machine)
    code = machine.emit_object(module)
    memory, linked = _inspected(code)
    if not linked <= set(LINKED):
        # Numba's ways of raising and of asking Python would be among them
        raise RuntimeError(f"export: the controller calls {', '.join(linked.difference(LINKED))}")
    contents = {
        "controller.o": code,
        "controller.h": _header(context, memory, name).encode(),
        "README": _readme(name, target, sorted(linked)).encode(),
        "made-from.json": _made_from(context, settings, name, target).encode(),
    }
    return ExportedController(contents, memory)


def _machine(architecture: str, cpu: str) -> Any:
    """LLVM's target machine. The system is "none": else LLVM calls what that system's library alone has, such as sincos."""
    llvm.initialize_all_targets()
    llvm.initialize_all_asmprinters()
    return llvm.Target.from_triple(f"{architecture}-none-elf").create_target_machine(
        cpu=cpu, opt=3, reloc="pic", codemodel="default"
    )


def _joined(context: UnitContext, settings: MpcSettings, machine: Any) -> Any:
    """One LLVM module of the unit's memory, the two functions of the header, and Numba's functions."""
    controller = compiled_unit(context, settings)  # kept: it owns the memory that is read here
    record = controller.kept[0]
    model = compiled_model(unit_model(with_predicted_curve(context)))
    functions = {name: _compiled(getattr(model, name)) for name in Addresses._fields}
    step = _compiled(unit_step)
    symbols = {
        getattr(record.problem.solver.model, name): f'@"{one.fndesc.llvm_func_name}"'
        for name, one in functions.items()
    }
    texts = [
        _memory(record, symbols) + _entry(step.fndesc.llvm_func_name, context.axles),
        *(str(one.library._get_module_for_linking()) for one in (step, *functions.values())),
    ]
    whole = None
    for text in texts:
        part = llvm.parse_assembly(text)
        part.triple, part.data_layout = machine.triple, str(machine.target_data)
        if whole is None:
            whole = part
        else:
            # what nothing refers to, such as wrappers for calls from Python, is left out
            whole.link_in(part)
    return whole


def _compiled(function: Any) -> Any:
    """What Numba has of a compiled function with one signature."""
    [made] = function.overloads.values()
    return made


def _arrays(record: Sequence[Any]) -> Iterator[np.ndarray]:
    """All arrays of a record and of those in it."""
    for item in record:
        inner = getattr(item, "_value", item)  # of one by reference
        if isinstance(inner, np.ndarray):
            yield inner
        elif hasattr(inner, "_fields"):
            yield from _arrays(inner)


def _memory(record: ByReference, functions: dict[int, str]) -> str:
    """The arrays and the record in LLVM's assembly, and `controller_init`; `functions`: symbols by address.

    A word of the record that is an address of this process becomes a symbol; the others are numbers.
    """
    contents, symbols = dict[int, bytes](), dict(functions)
    for array in _arrays(record._value):
        address = array.__array_interface__["data"][0]
        if array.size:
            contents[address] = array.tobytes()
        else:
            symbols.setdefault(address, "null")
    for (address, content), (following, _) in pairwise(sorted(contents.items())):
        assert address + len(content) <= following, "arrays that overlap"
    start, end = b"", 0
    # what is not zero at the start comes first; else in the order of the record, which is no matter of addresses
    for address, content in sorted(contents.items(), key=lambda item: not any(item[1])):
        symbols[address] = f"getelementptr (i8, ptr @memory, i64 {end})"
        end += -(-len(content) // _LINE) * _LINE
        start = (start + content).ljust(end, b"\0") if any(content) else start
    words = [
        f"i64 ptrtoint (ptr {symbols[word]} to i64)" if word in symbols else f"i64 {word}"
        for word in record.data.view(np.int64).tolist()
    ]
    filled, text = len(start), "".join(f"\\{byte:02x}" for byte in start)
    lines = [
        f"@memory = global [{end} x i8] zeroinitializer, align {_LINE}",
        f'@start = constant [{filled} x i8] c"{text}", align {_LINE}',
        f"@record = constant [{len(words)} x i64] [{', '.join(words)}]",
        *(f"declare i32 {one}()" for one in functions.values()),
        "declare void @llvm.memcpy.p0.p0.i64(ptr, ptr, i64, i1)",
        "declare void @llvm.memset.p0.i64(ptr, i8, i64, i1)",
        "define void @controller_init() {",
        f"call void @llvm.memcpy.p0.p0.i64(ptr @memory, ptr @start, i64 {filled}, i1 false)",
        f"%zeros = getelementptr i8, ptr @memory, i64 {filled}",
        f"call void @llvm.memset.p0.i64(ptr %zeros, i8 0, i64 {end - filled}, i1 false)",
        "ret void",
        "}",
    ]
    return "\n".join(lines)


def _entry(step: str, axles: int) -> str:
    """`controller_step` in LLVM's assembly: it calls Numba's function `step` as Numba does.

    That returns whether it raised. It gets an array as owner, parent, number, item size, address, shape and strides.
    """
    return f"""
declare void @raised()
declare i32 @"{step}"(ptr, ptr, i64, ptr, ptr, ptr, i64, i64, ptr, i64, i64, ptr)
define void @controller_step(ptr %reading, ptr %answer) {{
  %result = alloca ptr
  %error = alloca ptr
  %omega = getelementptr i8, ptr %reading, i64 {READING.itemsize}
  %code = call i32 @"{step}"(ptr %result, ptr %error, i64 ptrtoint (ptr @record to i64), ptr %reading,
    ptr null, ptr null, i64 {axles}, i64 8, ptr %omega, i64 {axles}, i64 8, ptr %answer)
  %bad = icmp ne i32 %code, 0
  br i1 %bad, label %raising, label %done
raising:
  call void @raised()
  br label %done
done:
  ret void
}}
"""


def _specialise(module: Any, machine: Any) -> None:
    """Let LLVM use that nobody else calls these functions, and that the record does not change."""
    for one in (*module.functions, *module.global_variables):
        if not one.is_declaration and one.name not in ("controller_init", "controller_step"):
            one.linkage = "internal"
    builder = llvm.create_pass_builder(machine, llvm.PipelineTuningOptions(speed_level=3))
    tidy = llvm.create_new_module_pass_manager()
    tidy.add_global_dead_code_eliminate_pass()
    tidy.add_strip_dead_prototype_pass()
    tidy.add_strip_symbols_pass()  # names contain counters of the process
    for _ in range(2):  # at first calls by address become plain ones, which the second time inlines
        tidy.run(module, builder)
        builder.getModulePassManager().run(module, builder)
    tidy.run(module, builder)
    module.verify()


_SYMBOL = np.dtype(
    [("name", "<u4"), ("kind", "u2"), ("section", "<u2"), ("value", "<u8"), ("size", "<u8")]
)
"""Entry of a symbol table. Source: System V ABI, chapter 4, Elf64_Sym."""


def _inspected(code: bytes) -> tuple[int, set[str]]:
    """Bytes of an object's memory that is written to, and the names of what it calls and does not contain."""
    memory, tables = 0, dict[str, bytes]()
    for one in llvm.ObjectFileRef.from_data(code).sections():
        name = (one.name() or b"").decode()
        memory += one.size() if name.startswith((".bss", ".data")) else 0
        if name in (".strtab", ".symtab"):
            tables[name] = one.data()
    names, symbols = tables[".strtab"], np.frombuffer(tables[".symtab"], _SYMBOL)
    begins = [one["name"] for one in symbols if one["section"] == 0 and one["name"]]
    return memory, {names[k : names.index(b"\0", k)].decode() for k in begins}


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
        "/* What the unit reads. */", *_structure("ControllerReading", READING, _READ, omega),
        "/* What it is to do. */", *_structure("ControllerAnswer", ANSWER, _ANSWERED),
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
