"""`readhesion export-controller`: the readhesion MPC of one unit as an object file for C."""

from functools import partial
from pathlib import Path

from studies.command_line.options import FilePath, Whole, check_whole
from studies.command_line.terminal import console
from studies.files.study_error import StudyError
from studies.files.writable import check_place, make_folder


def export_controller(scenario: str, *, unit: Whole, out: FilePath, target: str = "x86-64") -> None:
    """Write the readhesion MPC of one unit for C: controller.o, controller.h, README, and what they were made from.

    It is what the simulation runs, compiled for another processor: no allocation, no library but that of mathematics.

    Parameters
    ----------
    scenario
        Name of a shipped scenario or path of a TOML file, with the train and the settings `[onboard.mpc]`.
    unit
        Number of the traction unit, 1 = foremost.
    out
        Folder for the files.
    target
        Processor: x86-64, x86-64-v2, x86-64-v3, x86-64-v4 or aarch64. Higher levels are faster; only newer ones run them.
    """
    from alloc.onboard.equipment import equipment
    from alloc.onboard.host import unit_contexts
    from alloc.sources import write_whole
    from studies.scenario.loading import load_scenario

    chosen = load_scenario(scenario)
    event = chosen.event()
    units = event.model.layout.units
    if units == 0:
        raise StudyError(
            f"scenario {chosen.name!r}: its train has no motors, so there is no controller to export"
        )
    check_whole("--unit", unit, 1, units)
    check_place(out)
    from mpc.export import export_unit

    eq = equipment(event.model, event.onboard)
    context = unit_contexts(event.model, eq, event.onboard, "mpc")[unit - 1]
    made = export_unit(context, context.settings, target, f"unit {unit} of {chosen.name}")
    make_folder(out)
    for name, content in made.contents.items():
        write_whole(out / name, partial(Path.write_bytes, data=content))
    console().print(f"{out} holds the controller, of {made.memory} bytes of static memory")
