"""A figure as files: PDF and PNG, caption and data beside them, and in the files themselves where all of it comes from."""

import hashlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import matplotlib as mpl
from matplotlib.figure import Figure

from alloc.recording import provenance
from alloc.sources import write_whole
from paper_figs.drawn_data import drawn_data
from paper_figs.moving import MovingFigure
from paper_figs.origin import Origin
from paper_figs.style import STYLE_FILE
from studies.files.study_error import StudyError
from studies.files.writable import as_csv

MOVING = ".gif"
"""Ending of files of a figure that moves."""


@dataclass(frozen=True)
class Legend:
    """What is said of a figure beside it: its name, what it shows, and where its data come from."""

    name: str
    title: str
    """One line."""
    caption: str = ""
    """How it is to be read."""
    origins: tuple[Origin, ...] = ()

    @property
    def draft(self) -> str:
        """What a draft lacks, in one line; empty where nothing is missing."""
        lacking = dict.fromkeys(one for one in self.origins if one.draft)
        return "; ".join(f"draft: {one.shown}; in full: {one.command}" for one in lacking)

    def fields(self, data: bytes) -> dict[str, str]:
        """Provenance by name, with the hash of the data that are drawn."""
        origins = list(dict.fromkeys(self.origins))
        return {
            "Title": f"{self.name}: {self.title}",
            "Description": self.caption,
            "Software": _software(),
            "Source": " | ".join(one.words for one in origins) or "computed by the figure itself",
            "Data hash": f"sha256 {hashlib.sha256(data).hexdigest()}",
            "Status": self.draft or "complete",
        }

    def text(self, data: bytes) -> str:
        """The caption as a file: what is shown, and where it comes from."""
        told = self.fields(data)
        first = "\n\n".join(part for part in (_sentence(self.title), self.caption) if part)
        rest = "\n".join(f"{key}: {told[key]}" for key in ("Source", "Status", "Data hash", "Software"))  # fmt: skip
        return f"{first}\n\n{rest}\n"


def save_figure(drawn: Figure, path: Path, legend: Legend | None = None) -> list[Path]:
    """Write a figure as `path`.pdf and `path`.png, its caption as `path`.txt and its numbers as `path`.csv.

    One that moves is written as `path`.gif too.

    No file has the date, so equal figures are equal files.
    """
    said = Legend(path.name, path.name) if legend is None else legend
    files = [path.with_name(path.name + ending) for ending in (".pdf", ".png", ".txt", ".csv")]
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with mpl.rc_context(fname=STYLE_FILE):
            drawn.draw_without_rendering()
            drawn.set_layout_engine("none")  # laid out once: both files are the same to the point
            data = data_of(drawn)
            for image in files[:2]:
                save_image(drawn, image, said, data)
        write_whole(files[2], lambda file: file.write_text(said.text(data), encoding="utf-8"))
        write_whole(files[3], lambda file: file.write_bytes(data))
        if isinstance(drawn, MovingFigure):
            files.append(path.with_name(path.name + MOVING))
            with mpl.rc_context(fname=STYLE_FILE):
                save_image(drawn, files[-1], said, data)
    except OSError as error:
        raise StudyError(
            f"figure folder {str(path.parent)!r} cannot be written: {error.strerror}; choose another with --out"
        ) from None
    return files


def save_image(drawn: Figure, path: Path, legend: Legend, data: bytes) -> None:
    """Write one image; its ending gives the format, and what a format can say of itself it says."""
    if path.suffix.lower() == MOVING:
        if not isinstance(drawn, MovingFigure):
            raise StudyError(
                f"figure {str(path)!r}: {legend.name} does not move; take .pdf, .png or .svg"
            )
        comment = _comment(legend.fields(data))
        write_whole(path, lambda file: drawn.save_motion(file, comment))
        return
    told = legend.fields(data)
    spell = _IN_FORMAT.get(path.suffix.lower())
    metadata = None if spell is None else spell(told)
    write_whole(path, lambda file: drawn.savefig(file, metadata=metadata))


def data_of(drawn: Figure) -> bytes:
    """The numbers that are drawn as CSV, the same on every machine to nine digits."""
    table = drawn_data(drawn)
    return as_csv(table, float_format="%.9g", lineterminator="\n").encode()


def _pdf(told: Mapping[str, str]) -> dict[str, str | None]:
    words = "; ".join(f"{key}: {told[key]}" for key in ("Source", "Data hash", "Status"))
    return {
        "Title": told["Title"], "Subject": told["Description"], "Creator": told["Software"],
        "Keywords": words, "CreationDate": None,
    }  # fmt: skip


def _comment(told: Mapping[str, str]) -> str:
    """One line per field: a GIF has no fields of its own."""
    lines = (f"{key}: {' '.join(value.split())}" for key, value in told.items() if value)
    return "\n".join(lines)


def _svg(told: Mapping[str, str]) -> dict[str, str | None]:
    words = "; ".join(f"{key}: {told[key]}" for key in ("Data hash", "Status", "Software"))
    return {
        "Title": told["Title"], "Description": told["Description"] or None, "Source": told["Source"],
        "Coverage": words, "Date": None,
    }  # fmt: skip


_IN_FORMAT: Mapping[str, Callable[[Mapping[str, str]], Mapping[str, str | None]]] = {
    ".png": dict, ".pdf": _pdf, ".svg": _svg,
}  # fmt: skip
"""Provenance as a format can hold it, by the ending of its files."""


@cache
def _software() -> str:
    made = provenance()
    return f"readhesion {made['version_readhesion']}, revision {made['git_revision']}, matplotlib {mpl.__version__}"


def _sentence(words: str) -> str:
    return f"{words[:1].upper()}{words[1:]}".rstrip(".") + "."
