"""`readhesion new-scenario`: a scenario file of your own to begin with."""

from pathlib import Path

from studies.command_line.options import FilePath
from studies.command_line.terminal import console
from studies.files.study_error import StudyError
from studies.files.writable import check_place, make_folder

USUAL = "wet-start"


def new_scenario(name: str, *, like: str = USUAL, out: FilePath | None = None) -> None:
    """Write a scenario file that runs as it stands and shows every key with its meaning and default.

    Parameters
    ----------
    name
        Name of the scenario: letters, digits, and . + - _; the file is NAME.toml.
    like
        Scenario whose keys it begins with: the name of one that ships, or the path of a TOML file.
    out
        Folder for the file, or the file itself (.toml) [default: the present folder].
    """
    from studies.scenario.commented_file import commented_scenario
    from studies.scenario.loading import load_scenario, read_scenario
    from studies.scenario.scenario import safe_name

    if not name or safe_name(name) != name:
        raise StudyError(f"name {name!r}: give letters, digits, and . + - _ only")
    place = Path() if out is None else out
    path = place if place.suffix.lower() == ".toml" else place / f"{name}.toml"
    check_place(path.parent)
    load_scenario(like)  # what does not run is no beginning
    keys = {"title": f"as {like}", **read_scenario(like)}
    text = commented_scenario(name, like, _of_new_file(keys, name, path))
    make_folder(path.parent)
    try:
        with open(path, "x", encoding="utf-8") as file:
            file.write(text)
    except FileExistsError:
        raise StudyError(
            f"file {str(path)!r} exists, and is left as it is; choose another NAME or --out"
        ) from None
    except OSError as error:
        raise StudyError(f"file {str(path)!r} cannot be written: {error.strerror}") from None
    console().print(f"{path} runs as it stands: readhesion simulate {path}", highlight=False)


def _of_new_file(keys: dict[str, object], name: str, path: Path) -> dict[str, object]:
    """The keys as they stand in the new file: its name, where the file has another, and paths that hold from there."""
    from studies.scenario.train_keys import is_file

    keys = {key: value for key, value in keys.items() if key != "name"}
    train, line = keys.get("train"), keys.get("line")
    if isinstance(train, str) and is_file(train):
        keys["train"] = str(Path(train).absolute())
    if isinstance(line, dict) and isinstance(line.get("file"), str):
        keys["line"] = line | {"file": str(Path(line["file"]).absolute())}
    return keys if path.stem == name else {"name": name, **keys}
