"""The encoding of a table of text, by its first bytes."""

import codecs

MARKS = (
    (codecs.BOM_UTF8, "utf-8-sig"),
    (codecs.BOM_UTF16_LE, "utf-16"),
    (codecs.BOM_UTF16_BE, "utf-16"),
)
"""Byte-order marks and what they say."""
WIDE = 0.3
"""Share of zeros among every other byte from which on a text without a mark has two bytes a character."""
KANA, KANA_END = 0x81, 0x9F
"""First bytes of the usual Japanese characters in Shift-JIS; cp1252 has only quotation marks and the like there."""
JAPANESE = 0.5
"""Share of them among the bytes that begin no ASCII character, from which on a text is Japanese."""


def encoding_of(head: bytes) -> str:
    """Encoding of a text that begins with `head`: UTF-8, UTF-16, Shift-JIS or Western European."""
    for mark, name in MARKS:
        if head.startswith(mark):
            return "utf-8" if name == "utf-8-sig" else name
    odd, even = head[1::2].count(0), head[::2].count(0)
    if max(odd, even) > WIDE * (len(head) // 2):
        return "utf-16-le" if odd > even else "utf-16-be"
    if _decodes(head, "utf-8"):
        return "utf-8"
    if _is_japanese(head):
        return "cp932"
    return "cp1252" if _decodes(head, "cp1252") else "latin-1"


def _decodes(head: bytes, encoding: str) -> bool:
    """Whether bytes are text of an encoding; the last character may be cut."""
    try:
        codecs.getincrementaldecoder(encoding)().decode(head, final=False)
    except UnicodeDecodeError:
        return False
    return True


def _is_japanese(head: bytes) -> bool:
    if not _decodes(head, "cp932"):
        return False
    first, usual, k = 0, 0, 0
    while k < len(head):
        if head[k] < 0x80:
            k += 1
            continue
        first += 1
        usual += KANA <= head[k] <= KANA_END
        k += 1 if 0xA0 <= head[k] <= 0xDF else 2
    return usual >= JAPANESE * max(first, 1)
