"""A compiled function and the record that it works on as an object file, to be linked from C: its memory is built in.

In: a function that Numba has compiled, its record by reference, and a processor out of `TARGETS`. Out: an object with two
functions, one that starts anew and one that calls the compiled one.

Numba has optimised the function already. LLVM gets it once more here, together with the record that it reads. Every array
becomes static memory; every number and every address of the record a constant. So calls by address become plain calls,
branches that the numbers exclude vanish, and nothing is left to be looked up at the start. No multiplication and addition
are rounded as one (FMA). So every processor answers with the same bits, if its mathematical library does, and they are those
of Numba on a processor without FMA.
"""

from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import llvmlite.binding as llvm
import numpy as np

from alloc.records import ByReference

TARGETS = {
    **{f"x86-64{level}": ("x86_64", f"x86-64{level}") for level in ("", "-v2", "-v3", "-v4")},
    "aarch64": ("aarch64", ""),
}
"""Processors by name: architecture and processor in LLVM's words. Levels of x86-64: those of its System V ABI."""

LINKED = ("atan", "ceil", "cos", "exp", "floor", "fmod", "log", "memcpy", "memmove", "memset", "sin", "sqrt")  # fmt: skip
"""What the object may call: mathematics, and what C compilers call by themselves."""

_LINE = 64
"""Bytes to which every array is aligned: a cache line."""


class Object(NamedTuple):
    """An object file."""

    code: bytes
    memory: int
    """Bytes of static memory that is written to."""
    calls: tuple[str, ...]
    """What it calls and does not contain, of `LINKED`."""


class Entry(NamedTuple):
    """How C calls the function: `<prefix>_step`, in LLVM's assembly."""

    prefix: str
    parameters: str
    """Of `<prefix>_step`, with their types."""
    before: Sequence[str]
    """Instructions before the call."""
    arguments: Sequence[str]
    """Of the call, with their types; `@record` is the record."""

    def text(self, symbol: str) -> str:
        """The function; Numba's returns whether it raised."""
        kinds = ", ".join(one.partition(" ")[0] for one in self.arguments)
        lines = "\n  ".join(self.before)
        return f"""
declare void @raised()
declare i32 @"{symbol}"(ptr, ptr, {kinds})
define void @{self.prefix}_step({self.parameters}) {{
  %result = alloca ptr
  %error = alloca ptr
  {lines}
  %code = call i32 @"{symbol}"(ptr %result, ptr %error, {", ".join(self.arguments)})
  %bad = icmp ne i32 %code, 0
  br i1 %bad, label %raising, label %done
raising:
  call void @raised()
  br label %done
done:
  ret void
}}
"""


def vector(place: str, size: int) -> tuple[str, ...]:
    """A vector of floats as Numba's functions take it: owner, parent, number, item size, address, shape and stride."""
    return (
        "ptr null", "ptr null", f"i64 {size}", "i64 8", f"ptr {place}", f"i64 {size}", "i64 8"
    )  # fmt: skip


def object_file(
    entry: Entry, step: Any, record: ByReference, others: Mapping[int, Any], target: str
) -> Object:
    """The object with `<prefix>_init` and `<prefix>_step` of a compiled function for a processor.

    `others`: compiled functions whose addresses the record has, by address. Raises `RuntimeError` for a function that calls
    what is none of `LINKED`.
    """
    machine = _machine(*TARGETS[target])
    compiled = [_compiled(one) for one in (step, *others.values())]
    own, *symbols = (one.fndesc.llvm_func_name for one in compiled)
    places = {address: f'@"{symbol}"' for address, symbol in zip(others, symbols, strict=True)}
    whole = None
    for text in (
        _memory(record, places, entry.prefix) + entry.text(own),
        *(str(one.library._get_module_for_linking()) for one in compiled),
    ):
        part = llvm.parse_assembly(text)
        part.triple, part.data_layout = machine.triple, str(machine.target_data)
        if whole is None:
            whole = part
        else:
            # what nothing refers to, such as wrappers for calls from Python, is left out
            whole.link_in(part)
    _specialise(whole, machine, (f"{entry.prefix}_init", f"{entry.prefix}_step"))
    code = machine.emit_object(whole)
    memory, calls = _inspected(code)
    if not calls <= set(LINKED):
        # Numba's ways of raising and of asking Python would be among them
        raise RuntimeError(
            f"export: {entry.prefix}_step calls {', '.join(sorted(calls.difference(LINKED)))}"
        )
    return Object(code, memory, tuple(sorted(calls)))


def _machine(architecture: str, cpu: str) -> Any:
    """LLVM's target machine. The system is "none": else LLVM calls what that system's library alone has, such as sincos."""
    llvm.initialize_all_targets()
    llvm.initialize_all_asmprinters()
    return llvm.Target.from_triple(f"{architecture}-none-elf").create_target_machine(
        cpu=cpu, opt=3, reloc="pic", codemodel="default"
    )


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


def _memory(record: ByReference, functions: Mapping[int, str], prefix: str) -> str:
    """The arrays and the record in LLVM's assembly, and `<prefix>_init`; `functions`: symbols by address.

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
        f"define void @{prefix}_init() {{",
        f"call void @llvm.memcpy.p0.p0.i64(ptr @memory, ptr @start, i64 {filled}, i1 false)",
        f"%zeros = getelementptr i8, ptr @memory, i64 {filled}",
        f"call void @llvm.memset.p0.i64(ptr %zeros, i8 0, i64 {end - filled}, i1 false)",
        "ret void",
        "}",
    ]
    return "\n".join(lines)


def _specialise(module: Any, machine: Any, offered: Sequence[str]) -> None:
    """Let LLVM use that nobody else calls these functions, and that the record does not change."""
    for one in (*module.functions, *module.global_variables):
        if not one.is_declaration and one.name not in offered:
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
