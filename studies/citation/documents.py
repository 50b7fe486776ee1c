"""Documents whose equations or values this project uses, and how its sources name them.

Only facts that a document states itself, or that are known of it, stand here. Some entries have no title or no year.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True)
class Document:
    """A document; `fields` are those of its BibTeX entry of this `kind`."""

    key: str
    kind: str
    pattern: str
    """Regular expression of the names that docstrings and comments give it."""
    fields: Mapping[str, str] = field(hash=False)

    def bibtex(self) -> str:
        """The entry."""
        lines = [f"  {name} = {{{value}}}," for name, value in self.fields.items()]
        return "\n".join([f"@{self.kind}{{{self.key},", *lines, "}"])


def _patent(key: str, pattern: str, number: str, year: str, holder: str, title: str) -> Document:
    fields = {"author": f"{{{holder}}}", "title": title, "year": year, "howpublished": number}
    known = {name: value for name, value in fields.items() if value not in ("", "{}")}
    return Document(key, "misc", pattern, known | {"note": "title translated"} if title else known)


DOCUMENTS = (
    _patent(
        "JP5484215", r"JP ?5484215", "Japanese patent 5484215", "2014",
        "Nagaoka University of Technology and Toyo Denki Seizo",
        "Train control device with a train monitor and data transmission system",
    ),
    _patent(
        "JP4209318", r"JP ?4209318", "Japanese patent 4209318", "2009",
        "Railway Technical Research Institute and Mitsubishi Electric",
        "Quantitative evaluation of wheel damage under slide protection control of railway vehicles",
    ),
    _patent(
        "JPH07322414", r"JP H07-322414", "Japanese patent application H07-322414", "1995", "Toshiba",
        "Drive control device of a train and learning device of its running resistance",
    ),
    _patent("JPH05276606", r"JP H05-276606", "Japanese patent application H05-276606", "", "", ""),
    _patent("JP4225233", r"JP ?4225233", "Japanese patent 4225233", "", "", ""),
    Document("readhesion", "misc", r"[Rr]eadhesion paper|University of Tokyo", {
        "author": "Tsukinokizawa, Yutaka and Koseki, Takafumi and Negoro, Hideto and Murahashi, Akihiro",
        "title": "A calculation of the trajectory of tractive adhesion coefficient and readhesion possibility during "
        "readhesion control of an electric rolling stock",
    }),
    Document("hijikata", "misc", r"\bRTRI\b", {
        "author": "Hijikata, Daisuke and Nishimura, Toshiharu",
        "title": "Braking Force Estimation of Each Car",
        "organization": "Railway Technical Research Institute",
    }),
    Document("polach2005", "article", r"\bPolach", {
        "author": "Polach, Oldrich",
        "title": "Creep forces in simulations of traction vehicles running on adhesion limit",
        "journal": "Wear", "volume": "258", "pages": "992--1000", "year": "2005",
    }),
    Document("openrails", "misc", r"Open Rails", {"title": "Open Rails", "howpublished": "train simulator, source code"}),
    Document("kalker", "misc", r"\bKalker", {"author": "Kalker, Joost J.", "note": "table of creep coefficients"}),
    Document("curtius1950", "misc", r"Curtius", {"author": "Curtius, E. W. and Kniffler, A.", "year": "1950"}),
    Document("abouzeid2024", "misc", r"2406\.13650", {
        "author": "Abouzeid and others", "eprint": "2406.13650", "archiveprefix": "arXiv",
    }),
    Document("tian2014", "misc", r"Tian, Daniel", {"author": "Tian and Daniel and Meehan", "year": "2014"}),
    Document("zirek2020", "misc", r"Zirek", {"author": "Zirek and Onat", "year": "2020"}),
    Document("applsci10524", "article", r"Applied Sciences", {
        "journal": "Applied Sciences", "volume": "15", "number": "19", "pages": "10524", "year": "2025",
    }),
    Document("arasaratnam2009", "article", r"Arasaratnam", {
        "author": "Arasaratnam, Ienkaran and Haykin, Simon", "title": "Cubature {Kalman} Filters",
        "journal": "IEEE Transactions on Automatic Control", "volume": "54", "number": "6",
        "pages": "1254--1269", "year": "2009",
    }),
    Document("kennedy1995", "inproceedings", r"Kennedy and Eberhart", {
        "author": "Kennedy, James and Eberhart, Russell", "title": "Particle swarm optimization",
        "booktitle": "Proceedings of ICNN'95", "pages": "1942--1948", "year": "1995",
    }),
    Document("krstic2000", "article", r"Krstic", {
        "author": "Krstic, Miroslav and Wang, Hsin-Hsiung",
        "title": "Stability of extremum seeking feedback for general nonlinear dynamic systems",
        "journal": "Automatica", "volume": "36", "pages": "595--601", "year": "2000",
    }),
    Document("soderstrom2007", "article", r"Soederstroem", {
        "author": "S{\\\"o}derstr{\\\"o}m, Torsten", "title": "Errors-in-variables methods in system identification",
        "journal": "Automatica", "volume": "43", "pages": "939--958", "year": "2007",
    }),
    Document("kiencke1994", "misc", r"Kiencke", {"author": "Kiencke and Daiss", "year": "1994"}),
    Document("t1107", "techreport", r"T1107", {"number": "T1107", "institution": "RSSB"}),
)  # fmt: skip
"""Every document that a part of a run may name."""


def named_in(text: str) -> list[Document]:
    """Documents that a text names, in the order of `DOCUMENTS`."""
    plain = " ".join(text.split())
    return [one for one in DOCUMENTS if re.search(one.pattern, plain)]
