"""The command `readhesion`: its commands, exit codes, and what goes wrong in one line. `__main__` starts it."""

import os
import sys
import warnings
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Annotated

from cyclopts import App, CycloptsError, Parameter, UnusedCliTokensError

from studies.command_line.analyse import analyse
from studies.command_line.compare import compare, merge, sweep
from studies.command_line.list import check, list_names, new_scenario, schema
from studies.command_line.run_line import run_line
from studies.command_line.simulate import simulate
from studies.command_line.write_report import (
    cite,
    export_controller,
    export_fmu,
    export_qps,
    figures,
    write_report,
)
from studies.files.study_error import StudyError

FAILED = 1
BAD_INPUT = 2
UNREAD = 141
LONGEST = 1500
"""Letters of a message; what was given may be longer."""

app = App(
    name="readhesion",
    help="How a train of many cars should share adhesion when its wheels slip.",
    version=version("readhesion"),
    help_on_error=False,
    suppress_keyboard_interrupt=False,  # `interruption.ends` says what it leaves behind
)
for command in (
    compare, simulate, run_line, sweep, merge, figures, analyse, check, cite, export_controller, export_fmu, export_qps,
    new_scenario, schema,
):  # fmt: skip
    app.command(command)
app.command(list_names, name="list")
app.command(write_report, name="report")
app.register_install_completion_command(add_to_startup=False)  # leaves the shell's own files alone
app.meta.suppress_keyboard_interrupt = False


@app.meta.default
def launch(
    *tokens: Annotated[str, Parameter(show=False, allow_leading_hyphen=True)],
    plugin: Annotated[list[Path] | None, Parameter(negative_iterable=())] = None,
    limits: float | None = None,
) -> int | None:
    """Run a command, after loading plug-ins and setting limits.

    Parameters
    ----------
    plugin
        Python file that registers rules, controllers, curves, trains, metrics, scenarios or figures;
        may be given again for further files.
    limits
        Factor of the usual limits on files that are read: bytes of a scenario, train or line, values of a log.
    """
    if limits is not None:
        from studies.files.limits import VARIABLE, factor

        os.environ[VARIABLE] = f"{limits:g}"
        factor()
    if plugin:
        from studies.core.plugins import use_plugins

        use_plugins(plugin)
    code: int | None = app(
        tokens, exit_on_error=False, print_error=False, result_action="return_value"
    )
    return code


def run(arguments: Sequence[str] | None = None) -> int:
    """Run the command; returns the exit code.

    0; 1 if all failed; 2 for bad input (one line on stderr); 141 when nobody reads what it prints. An interrupt is raised.
    """
    from alloc.errors import InputError, UnsoundRun, check_compiling

    try:
        check_compiling()
        with warnings.catch_warnings():
            warnings.showwarning = _Once()  # type: ignore[assignment]
            code = app.meta(
                arguments, exit_on_error=False, print_error=False, result_action="return_value"
            )
        if sys.stdout is not None:
            sys.stdout.flush()
    except BrokenPipeError:
        return _unread()
    except UnusedCliTokensError as error:
        words = ", ".join(map(repr, error.unused_tokens or ()))
        compares = {"compare", "report"} & set(error.command_chain or ())
        hint = "events go after --scenario" if compares else "--help has the options"
        return _refuse(f"{words}: no option takes this; {hint}")
    except (CycloptsError, InputError, StudyError) as error:
        return _refuse(str(error))
    except OSError as error:
        named = error.filename is not None and error.strerror
        return _refuse(f"file {str(error.filename)!r}: {error.strerror}" if named else str(error))
    except UnsoundRun as error:
        _refuse(str(error))
        return FAILED
    return code if isinstance(code, int) else 0


def _refuse(message: str) -> int:
    line = " ".join(message.split())
    if len(line) > LONGEST:
        line = f"{line[: LONGEST // 2]} ... {line[-LONGEST // 2 :]}"
    print(f"readhesion: {line}", file=sys.stderr)
    return BAD_INPUT


def _unread() -> int:
    """Nobody reads on, as after `| head`: what is still to be printed at the end goes nowhere."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    return UNREAD


class _Once:
    """Says each warning once, also where a file is read again."""

    def __init__(self) -> None:
        self.said: set[str] = set()

    def __call__(self, message: Warning | str, *_: object) -> None:
        line = " ".join(str(message).split())
        if line not in self.said:
            self.said.add(line)
            print(f"readhesion: {line}", file=sys.stderr)
