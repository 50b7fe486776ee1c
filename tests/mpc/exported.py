"""An exported controller, compiled by the system's compiler and asked from Python beside the one that Numba compiles."""

import ctypes
import shutil
import subprocess

import numpy as np
import pytest

from alloc.onboard.compiled_controller import ANSWER, READING
from mpc.export.unit_export import export_unit
from mpc.unit_step import compiled_unit, unit_step

COMPILER = next((name for name in ("cc", "gcc", "clang") if shutil.which(name)), "")
needs_compiler = pytest.mark.skipif(not COMPILER, reason="no C compiler on this machine")
STRICT = ("-Wall", "-Wextra", "-Werror", "-std=c99", "-pedantic", "-O2")


def write(files, folder):
    """Write an exported controller into a folder; returns the folder."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in files.contents.items():
        (folder / name).write_text(text)
    return folder


def run_compiler(folder, *arguments):
    """Run the system's compiler in a folder; raises what it says."""
    done = subprocess.run(
        [COMPILER, *arguments], cwd=folder, capture_output=True, text=True, timeout=300.0
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


class InC:
    """A controller in C."""

    def __init__(self, context, settings, folder, *flags):
        self.files = export_unit(context, settings)
        write(self.files, folder)
        run_compiler(
            folder,
            *STRICT,
            *flags,
            "-shared",
            "-fPIC",
            "controller.c",
            "-o",
            "controller.so",
            "-lm",
        )
        self.library = ctypes.CDLL(str(folder / "controller.so"))
        fields = [(name, float) for name in READING.names if name != "slipping"]
        whole = np.dtype([*fields, ("slipping", np.int64), ("omega", float, (context.axles,))])
        assert whole.itemsize == READING.itemsize + 8 * context.axles
        self.reading, self.answer = np.zeros(1, whole), np.zeros(1, ANSWER)
        self.start()

    def start(self):
        self.library.controller_init()

    def decide(self, sense):
        for name in (*READING.names, "omega"):
            self.reading[name] = getattr(sense, name)
        self.step()
        return self.answer[0]

    def step(self):
        self.library.controller_step(
            ctypes.c_void_p(self.reading.ctypes.data), ctypes.c_void_p(self.answer.ctypes.data)
        )

    def step_in_phases(self):
        """The same by the two calls of a controller whose phases are apart."""
        self.library.controller_feedback(
            ctypes.c_void_p(self.reading.ctypes.data), ctypes.c_void_p(self.answer.ctypes.data)
        )
        answer = self.answer.tobytes()
        self.library.controller_prepare()
        assert self.answer.tobytes() == answer, "the command is out before the preparation"


class InNumba:
    """The same compiled by Numba, as the simulation has it."""

    def __init__(self, context, settings=None):
        self.controller = compiled_unit(context, settings)
        self.reading, self.answer = np.zeros(1, READING)[0], np.zeros(1, ANSWER)[0]

    def decide(self, sense):
        for name in READING.names:
            self.reading[name] = getattr(sense, name)
        unit_step(self.controller.state, self.reading, sense.omega, self.answer)
        return self.answer


def run_tool(*arguments):
    """What a tool of the compiler prints."""
    done = subprocess.run(list(map(str, arguments)), capture_output=True, text=True, timeout=60.0)
    assert done.returncode == 0, done.stderr
    return done.stdout
