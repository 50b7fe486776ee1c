"""`readhesion export-controller`: the readhesion MPC of one unit as C."""

from functools import partial
from pathlib import Path

from studies.command_line.options import FilePath, Whole, check_whole
from studies.command_line.terminal import console
from studies.files.study_error import StudyError
from studies.files.writable import check_place, make_folder


def export_controller(scenario: str, *, unit: Whole, out: FilePath) -> None:
    """Write the readhesion MPC of one unit as C99: controller.h, controller.c, and what they were made from.

    It is what the simulation runs, translated from the same source: no allocation, no library but math.h.

    Parameters
    ----------
    scenario
        Name of a shipped scenario or path of a TOML file, with the train and the settings `[onboard.mpc]`.
    unit
        Number of the traction unit, 1 = foremost.
    out
        Folder for the files.
    """
    from alloc.onboard.equipment import equipment
    from alloc.onboard.host import unit_contexts
    from alloc.whole_file import write_whole
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
    from mpc.export.c_kinds import TranslationError
    from mpc.export.unit_export import export_unit

    eq = equipment(event.model, event.onboard)
    context = unit_contexts(event.model, eq, event.onboard, "mpc")[unit - 1]
    try:
        made = export_unit(context, context.settings, f"unit {unit} of {chosen.name}")
    except TranslationError as error:
        raise StudyError(f"scenario {chosen.name!r}, --unit {unit}: {error}") from None
    make_folder(out)
    for name, text in made.contents.items():
        write_whole(out / name, partial(Path.write_text, data=text, encoding="utf-8"))
    console().print(f"{out} holds the controller, of {made.memory} bytes of static memory")
