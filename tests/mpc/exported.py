"""An exported controller, linked to a program in C and asked beside the one that Numba compiles."""

import shutil
import subprocess

import numpy as np

from alloc.onboard.host import ANSWER, READING
from mpc.unit import compiled_unit, unit_step

COMPILER = next((name for name in ("cc", "gcc", "clang") if shutil.which(name)), "")
STRICT = ("-Wall", "-Wextra", "-Werror", "-std=c99", "-pedantic", "-O0")
MAIN = """
#include <stdio.h>
#include "controller.h"

int main(void)
{
  ControllerReading reading;
  ControllerAnswer answer;
  controller_init();
  while (fread(&reading, sizeof reading, 1, stdin) == 1) {
    if (reading.time < 0.0) controller_init();
    controller_step(&reading, &answer);
    fwrite(&answer, sizeof answer, 1, stdout);
  }
  return 0;
}
"""
"""Answers to readings; one of a time below 0 starts anew."""


def write(files, folder):
    """Write an exported controller into a folder; returns the folder."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, content in files.contents.items():
        (folder / name).write_bytes(content)
    return folder


def run_tool(folder, *command, given=b""):
    """What a command prints that is run in a folder; raises what it says against it."""
    done = subprocess.run(
        list(map(str, command)), cwd=folder, input=given, capture_output=True, timeout=600.0
    )
    assert done.returncode == 0, done.stderr.decode()
    assert not done.stderr, "a warning of the linker"
    return done.stdout


def link(folder, text=MAIN, *more):
    """Compile a program in C and link it to the object; returns what is to be run."""
    (folder / "main.c").write_text(text)
    run_tool(folder, COMPILER, *STRICT, "main.c", "controller.o", *more, "-lm")
    return folder / "a.out"


def packed(senses, axles):
    """Readings as the C program takes them."""
    fields = [(name, READING[name]) for name in READING.names]
    made = np.zeros(len(senses), np.dtype([*fields, ("omega", float, (axles,))]))
    for k, sense in enumerate(senses):
        made[k] = tuple(getattr(sense, name) for name in made.dtype.names)
    return made


def asked(program, readings):
    """Answers of a program to readings, started anew after the last: each twice, which must be the same."""
    again = readings.copy()
    again["time"][0] = -1.0
    given = readings.tobytes() + again.tobytes()
    first, second = np.frombuffer(run_tool(None, program, given=given), ANSWER).reshape(2, -1)
    assert first.tobytes() == second.tobytes(), "a start forgets all"
    return first


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


def of_numba(cases):
    """Answers of Numba's controllers; `cases`: (context, settings, senses) by name."""
    answers = {}
    for name, (context, settings, senses) in cases.items():
        one = InNumba(context, settings)
        answers[name] = np.array([one.decide(sense).copy() for sense in senses], ANSWER)
    return answers
