"""Real lines and trains put into a scenario from the command line."""

from pathlib import Path

from studies.files.study_error import StudyError
from studies.lines.named_files import line_file
from studies.scenario.line_file import read_line
from studies.scenario.scenario import Scenario, safe_name


def with_real_input(scenario: Scenario, line: str | None, train: str | None) -> Scenario:
    """The same event with the line and the train of files; it starts where the line's steepest climb starts.

    Loads, couplers and failures belong to the scenario's own train. Raises `StudyError` where files and scenario do not fit.
    """
    changes: dict[str, object] = {}
    name = scenario.name
    if line is not None:
        line = line_file(line)
        path = read_line(line)
        section = path.steepest()
        grade = 1e3 * section.grade
        changes["line"] = {"file": line}
        changes["start_m"] = section.start
        changes["title"] = (
            f"{scenario.title}; on {Path(line).name}, {section.start:.0f} m to {section.end:.0f} m, "
            f"{grade:g} per mille"
        )
        name += f"+{safe_name(Path(line).stem)}"
    if train is not None:
        if scenario.load_t is not None or scenario.failures:
            raise StudyError(
                f"--train does not fit scenario {scenario.name!r}, which loads or fails cars of its own "
                "train; choose another --scenario"
            )
        changes |= {"train": train, "coupler": None}
        name += f"+{safe_name(Path(train).stem)}"
    changed = scenario.changed(name=name, **changes)
    changed.event()  # a file that does not hold a train shows now, not as a failed row
    return changed
