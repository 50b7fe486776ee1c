"""The publications that the code names, each in one place: by what docstrings call it, and as BibTeX.

A file names its source in a docstring or a comment; `cited_in` finds which of `SOURCES` a text names. So nobody keeps a
second list of who uses what. Titles of patents are translated here; names stand as the source prints them. A title in
brackets says what a publication is used for, where its own is not at hand.
"""

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True)
class Citation:
    """A publication."""

    key: str
    """Of its BibTeX entry."""
    kind: str
    """Of its BibTeX entry, such as "article"."""
    marks: tuple[str, ...]
    """What docstrings and comments call it; any of them names it, as whole words."""
    fields: Mapping[str, str] = field(hash=False)
    """Those of its BibTeX entry, in the order in which they are written."""

    @property
    def bibtex(self) -> str:
        """Its BibTeX entry."""
        lines = [f"  {name} = {{{value}}}," for name, value in self.fields.items()]
        return "\n".join([f"@{self.kind}{{{self.key},", *lines, "}"])

    @property
    def words(self) -> str:
        """Authors or holder, title, and where it was published, in one line."""
        by = self.fields.get("holder") or self.fields.get("author", "").replace(" and ", ", ")
        names = ("journal", "booktitle", "institution", "number", "volume", "pages", "year")
        where = ", ".join(self.fields[name] for name in names if name in self.fields)
        return (
            ". ".join(part.rstrip(".") for part in (by, self.fields["title"], where) if part) + "."
        )

    @property
    def address(self) -> str:
        """Where it can be found; empty where no lasting address is known."""
        if "doi" in self.fields:
            return f"https://doi.org/{self.fields['doi']}"
        return f"https://arxiv.org/abs/{self.fields['eprint']}" if "eprint" in self.fields else ""


CITATIONS: tuple[Citation, ...] = (
    Citation("JP5484215", "patent", ("JP5484215", "JP 5484215"), {
        "author": "大石 潔 and 今井 一富 and 佐野 孝 and 野村 英児 and 牧島 信吾 and 保川 忍",
        "holder": "Nagaoka University of Technology, Toyo Denki",
        "title": "Train control device with a train monitor and data transmission system (in Japanese)",
        "number": "JP 5484215", "year": "2014",
    }),
    Citation("JP4209318", "patent", ("JP4209318", "JP 4209318"), {
        "author": "野中 俊昭 and 板野 康晴 and 吉川 広 and 大山 忠夫 and 遠藤 靖典",
        "holder": "Railway Technical Research Institute, Mitsubishi Electric",
        "title": "Quantitative evaluation of wheel damage under slide protection of railway vehicles (in Japanese)",
        "number": "JP 4209318", "year": "2009",
    }),
    Citation("tsukinokizawa", "inproceedings", ("readhesion paper", "Readhesion paper", "University of Tokyo"), {
        "author": "Tsukinokizawa, Yutaka and Koseki, Takafumi and Negoro, Hideto and Murahashi, Akihiro",
        "title": "A calculation of the trajectory of tractive adhesion coefficient and readhesion possibility during "
                 "readhesion control of an electric rolling stock (in Japanese)",
        "note": "The University of Tokyo, Mitsubishi Electric; the copy at hand states neither volume nor year",
    }),
    Citation("JPH07322414", "patent", ("JP H07-322414", "JPH07322414"), {
        "author": "水谷 麻美", "holder": "Toshiba",
        "title": "Drive control device of a train, and device that learns its running resistance (in Japanese)",
        "number": "JP H07-322414 A", "year": "1995",
    }),
    Citation("hijikata", "article", ("RTRI report", "Hijikata"), {
        "author": "Hijikata, Daisuke and Nishimura, Toshiharu",
        "title": "Braking Force Estimation of Each Car (in Japanese)",
        "institution": "Railway Technical Research Institute",
        "note": "the copy at hand states neither volume nor year",
    }),
    Citation("JPH05276606", "patent", ("JP H05-276606",), {
        "title": "Preset pattern of effort along a train, as JP 5484215, par. 0007, describes it",
        "number": "JP H05-276606 A",
    }),
    Citation("JP4225233", "patent", ("JP 4225233", "JP4225233"), {
        "title": "Dynamic sharing of effort along a train, as JP 5484215, par. 0007 and 0009, describes it",
        "number": "JP 4225233",
    }),
    Citation("polach2005", "article", ("Polach",), {
        "author": "Polach, Oldrich",
        "title": "Creep forces in simulations of traction vehicles running on adhesion limit",
        "journal": "Wear", "volume": "258 (7-8)", "pages": "992-1000", "year": "2005",
        "doi": "10.1016/j.wear.2004.03.046",
    }),
    Citation("curtius1950", "article", ("Curtius",), {
        "author": "Curtius, E. W. and Kniffler, A.",
        "title": "Neue Erkenntnisse über die Haftung zwischen Treibrad und Schiene",
        "journal": "Elektrische Bahnen", "year": "1950",
    }),
    Citation("charnes1959", "article", ("Charnes",), {
        "author": "Charnes, A. and Cooper, W. W.", "title": "Chance-Constrained Programming",
        "journal": "Management Science", "volume": "6 (1)", "pages": "73-79", "year": "1959",
        "doi": "10.1287/mnsc.6.1.73",
    }),
    Citation("tian2014", "inproceedings", ("Tian",), {
        "author": "Tian, Y. and Daniel, W. J. T. and Liu, S. and Meehan, P. A.",
        "title": "Fuzzy logic creep control for a 2D locomotive dynamic model under transient wheel-rail contact "
                 "conditions",
        "booktitle": "Computers in Railways XIV, WIT Transactions on The Built Environment",
        "volume": "135", "pages": "885", "year": "2014", "doi": "10.2495/CR140741",
    }),
    Citation("abouzeid2024", "misc", ("Abouzeid", "2406.13650"), {
        "author": "Abouzeid, Ahmed Fathy and Guerrero, Juan Manuel and Lejarza, Lander and Muniategui, Iker and "
                  "Endemaño, Aitor and Briz, Fernando",
        "title": "Advanced Maximum Adhesion Tracking Strategies in Railway Traction Drives",
        "year": "2024", "eprint": "2406.13650", "archiveprefix": "arXiv",
    }),
    Citation("zirek2020", "article", ("Zirek",), {
        "author": "Zirek, Abdulkadir and Onat, Altan",
        "title": "A novel anti-slip control approach for railway vehicles with traction based on adhesion estimation with "
                 "swarm intelligence",
        "journal": "Railway Engineering Science", "volume": "28", "year": "2020",
        "doi": "10.1007/s40534-020-00223-w",
    }),
    Citation("applsci2025", "article", ("15(19), 10524", "Applied Sciences"), {
        "title": "Adhesion Control of High-Speed Train Based on Improved Nonlinear Kalman Filter",
        "journal": "Applied Sciences", "volume": "15 (19)", "pages": "10524", "year": "2025",
        "doi": "10.3390/app151910524",
    }),
    Citation("arasaratnam2009", "article", ("Arasaratnam",), {
        "author": "Arasaratnam, Ienkaran and Haykin, Simon", "title": "Cubature Kalman Filters",
        "journal": "IEEE Transactions on Automatic Control", "volume": "54 (6)", "pages": "1254-1269", "year": "2009",
    }),
    Citation("kennedy1995", "inproceedings", ("Kennedy and Eberhart",), {
        "author": "Kennedy, James and Eberhart, Russell", "title": "Particle swarm optimization",
        "booktitle": "Proceedings of ICNN'95", "pages": "1942-1948", "year": "1995",
    }),
    Citation("krstic2000", "article", ("Krstic",), {
        "author": "Krstic, Miroslav and Wang, Hsin-Hsiung",
        "title": "Stability of extremum seeking feedback for general nonlinear dynamic systems",
        "journal": "Automatica", "volume": "36", "pages": "595-601", "year": "2000",
    }),
    Citation("soderstrom2007", "article", ("Soederstroem",), {
        "author": "Söderström, Torsten", "title": "Errors-in-variables methods in system identification",
        "journal": "Automatica", "volume": "43", "pages": "939-958", "year": "2007",
    }),
    Citation("kiencke1994", "misc", ("Kiencke",), {
        "author": "Kiencke and Daiss", "title": "(rational curve of adhesion)", "year": "1994",
    }),
    Citation("kalker", "misc", ("Kalker",), {
        "author": "Kalker, Joost J.", "title": "(table of creep coefficients)",
    }),
    Citation("t1107", "techreport", ("T1107",), {
        "institution": "RSSB", "title": "(full-scale trial of sanders)", "number": "T1107",
    }),
    Citation("openrails", "misc", ("Open Rails",), {
        "title": "Open Rails", "howpublished": "train simulator, source code",
    }),
)  # fmt: skip
"""The source documents first, then the prior art they name, then what others published."""


def cited_in(text: str) -> list[Citation]:
    """The publications that a text names, in the order of `CITATIONS`."""
    plain = " ".join(text.split())  # a name may be broken over two lines

    def names(mark: str) -> bool:
        return re.search(rf"(?<!\w){re.escape(mark)}(?!\w)", plain) is not None

    return [one for one in CITATIONS if any(map(names, one.marks))]


def uses(texts: Mapping[str, str] | Iterable[tuple[str, str]]) -> dict[Citation, list[str]]:
    """Which of the things in `texts`, each with what is written about it, names which publication."""
    found: dict[Citation, list[str]] = {}
    for thing, text in dict(texts).items():
        for one in cited_in(text):
            found.setdefault(one, []).append(thing)
    return {one: found[one] for one in CITATIONS if one in found}
