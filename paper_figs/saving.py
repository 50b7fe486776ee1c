"""A figure as files: PDF, PNG or GIF, caption and data beside them; all of them say where they come from."""

import hashlib
import io
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import NamedTuple

import matplotlib as mpl
from matplotlib.figure import Figure
from PIL import Image

from alloc.recording import provenance
from alloc.sources import write_whole
from paper_figs.drawn_data import drawn_data
from paper_figs.style import STYLE_FILE
from studies.files.study_error import StudyError
from studies.files.writable import as_csv

MOVING = ".gif"
"""Ending of files of a figure that moves."""
PIXELS = 200
"""Of a GIF per inch: a column has 700."""


@dataclass(frozen=True)
class Origin:
    """Where data come from."""

    command: str
    """The command that gives them in full."""
    shown: str
    """What is drawn, in words: events or runs."""
    seeds: tuple[int, ...]
    draft: bool = False
    """Whether the command gives more events than are drawn."""

    @property
    def words(self) -> str:
        """What is drawn, from which seeds, and where it comes from."""
        shown = self.shown
        if self.seeds:
            seeds = "seed" if len(self.seeds) == 1 else "seeds"
            shown += f", {seeds} {', '.join(map(str, self.seeds))}"
        return f"{shown}; `{self.command}`"


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
        title = f"{self.title[:1].upper()}{self.title[1:]}".rstrip(".") + "."
        first = "\n\n".join(part for part in (title, self.caption) if part)
        rest = "\n".join(f"{key}: {told[key]}" for key in ("Source", "Status", "Data hash", "Software"))  # fmt: skip
        return f"{first}\n\n{rest}\n"


class Motion(NamedTuple):
    """What moves in a figure."""

    show: Callable[[int], None]
    """Makes the figure show the instant of this number."""
    instants: int
    rate: int
    """Instants that are shown in a second."""
    still: int
    """The instant at which the figure stands."""


class MovingFigure(Figure):
    """A figure that shows one instant, as any other figure, and all of them in a GIF."""

    motion: Motion

    def save_motion(self, path: Path, comment: str = "") -> None:
        """Write all instants as a GIF that repeats, with a comment inside; afterwards the figure stands as before."""
        motion = self.motion
        self.draw_without_rendering()
        self.set_layout_engine("none")  # nothing jumps while numbers change
        first, *rest = [self._picture(instant) for instant in range(motion.instants)]
        motion.show(motion.still)
        first.save(
            path, format="GIF", save_all=True, append_images=rest, duration=1000 // motion.rate, loop=0,
            comment=comment.encode(),
        )  # fmt: skip

    def _picture(self, instant: int) -> Image.Image:
        """One instant as pixels."""
        self.motion.show(instant)
        drawn = io.BytesIO()
        self.savefig(drawn, format="png", dpi=PIXELS)
        return Image.open(drawn).convert("RGB")


def save_figure(drawn: Figure, path: Path, legend: Legend | None = None) -> list[Path]:
    """Write a figure as `path`.pdf and `path`.png, its caption as `path`.txt and its numbers as `path`.csv.

    One that moves is written as `path`.gif too. No file has the date, so equal figures are equal files. Raises `StudyError`
    where the folder cannot be written.
    """
    said = Legend(path.name, path.name) if legend is None else legend
    files = [path.with_name(path.name + ending) for ending in (".pdf", ".png", ".txt", ".csv")]
    images = files[:2]
    if isinstance(drawn, MovingFigure):
        files.append(path.with_name(path.name + MOVING))
        images = [*images, files[-1]]
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with mpl.rc_context(fname=STYLE_FILE):
            drawn.draw_without_rendering()
            drawn.set_layout_engine("none")  # laid out once: all files are the same to the point
            data = data_of(drawn)
            for image in images:
                save_image(drawn, image, said, data)
        write_whole(files[2], lambda file: file.write_text(said.text(data), encoding="utf-8"))
        write_whole(files[3], lambda file: file.write_bytes(data))
    except OSError as error:
        raise StudyError(
            f"figure folder {str(path.parent)!r} cannot be written: {error.strerror}; choose another with --out"
        ) from None
    return files


def save_image(drawn: Figure, path: Path, legend: Legend, data: bytes) -> None:
    """Write one image; its ending gives the format, and what a format can say of itself it says."""
    told, ending = legend.fields(data), path.suffix.lower()
    if ending != MOVING:
        spell = _IN_FORMAT.get(ending)
        metadata = None if spell is None else spell(told)
        write_whole(path, lambda file: drawn.savefig(file, metadata=metadata))
    elif isinstance(drawn, MovingFigure):
        # a GIF has no fields of its own
        lines = (f"{key}: {' '.join(value.split())}" for key, value in told.items() if value)
        comment = "\n".join(lines)
        write_whole(path, lambda file: drawn.save_motion(file, comment))
    else:
        raise StudyError(
            f"figure {str(path)!r}: {legend.name} does not move; take .pdf, .png or .svg"
        )


def data_of(drawn: Figure) -> bytes:
    """The numbers that are drawn as CSV, the same on every machine to nine digits."""
    table = drawn_data(drawn)
    return as_csv(table, float_format="%.9g", lineterminator="\n").encode()


def _pdf(told: Mapping[str, str]) -> dict[str, str | None]:
    return {
        "Title": told["Title"], "Subject": told["Description"], "Creator": told["Software"],
        "Keywords": _joined(told, "Source", "Data hash", "Status"), "CreationDate": None,
    }  # fmt: skip


def _svg(told: Mapping[str, str]) -> dict[str, str | None]:
    return {
        "Title": told["Title"], "Description": told["Description"] or None, "Source": told["Source"],
        "Coverage": _joined(told, "Data hash", "Status", "Software"), "Date": None,
    }  # fmt: skip


def _joined(told: Mapping[str, str], *keys: str) -> str:
    return "; ".join(f"{key}: {told[key]}" for key in keys)


_IN_FORMAT: Mapping[str, Callable[[Mapping[str, str]], Mapping[str, str | None]]] = {
    ".png": dict, ".pdf": _pdf, ".svg": _svg,
}  # fmt: skip
"""Provenance as a format can hold it, by the ending of its files."""


@cache
def _software() -> str:
    made = provenance()
    return f"readhesion {made['version_readhesion']}, revision {made['git_revision']}, matplotlib {mpl.__version__}"
