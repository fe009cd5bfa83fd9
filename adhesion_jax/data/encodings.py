"""How a text file writes its characters: UTF-8, UTF-16, or an encoding of one byte a character."""

import re
from io import BufferedIOBase

from adhesion_jax.errors import InputError

#: Bytes read at a time, of which the first show UTF-16, and around what is no UTF-8.
_CHUNK = 1 << 22
_HEAD = 1 << 18
_AROUND = 1 << 14

_MARKS = {
    b"\xef\xbb\xbf": "utf-8-sig",
    b"\xff\xfe": "utf-16",
    b"\xfe\xff": "utf-16",
}

#: Characters beyond ASCII that tables of measurements have: signs, which stand in no word (but ²
#: and ³ follow a letter), and letters.
_SIGNS = "°µ±·Ω€‰№–…„“”’´«»"
_WESTERN = "äöüßÄÖÜéèêëàâçîïôûùáíóúñåøæÅØÆÉÈÀÇÑ"
_EASTERN = "äöüßÄÖÜéáíóúýąćęłńśźżčďěňřšťůžőűăâîșțşţĄĆĘŁŃŚŹŻČĎĚŇŘŠŤŮŽŐŰ"

#: Encodings of one byte a character that spreadsheets and loggers in Europe write, the most usual
#: first, and their letters.
_LETTERS = {
    "cp1252": _WESTERN,
    "cp850": _WESTERN,
    "mac_roman": _WESTERN,
    "cp1250": _EASTERN,
    "cp1251": "".join(map(chr, range(0x410, 0x450))),
}

#: The share of the characters beyond ASCII that are these, at least.
_MOSTLY = 0.5

#: What no text has.
_CONTROL = re.compile(rb"[\x01-\x08\x0e-\x1a\x1c-\x1f]")


def encoding_of(stream: BufferedIOBase, path: str) -> str:
    """The encoding of a whole file, which is read once for that; InputError for a binary file."""
    chunk = stream.read(_CHUNK)
    for mark, encoding in _MARKS.items():
        if chunk.startswith(mark):
            return encoding
    if b"\0" in chunk[:_HEAD]:
        return _sixteen(chunk[:_HEAD], path)
    strange = b""
    left = b""
    while chunk:
        whole = left + chunk
        left = b""
        if not whole.isascii():
            try:
                whole.decode()
            except UnicodeDecodeError as error:
                if error.reason == "unexpected end of data" and len(whole) - error.start < 4:
                    left = whole[error.start :]  # a character that goes on in the next chunk
                else:
                    strange = whole[max(error.start - _AROUND, 0) : error.start + _AROUND]
                    break
        chunk = stream.read(_CHUNK)
    if not strange and not left:
        return "utf-8"
    found = None if b"\0" in strange + left else _one_byte(strange or left)
    if found is None:
        raise InputError(
            f"{path} is a binary file or text of an unknown encoding; save the table as "
            "comma-separated UTF-8 text."
        )
    return found


def _one_byte(content: bytes) -> str | None:
    """The encoding in which most characters beyond ASCII are those of tables; None where none is.

    Where several make as many of them, the first counts. A table of numbers has no language, by
    which an encoding of prose is told; so a sign counts where it stands in no word, as in °C, and a
    letter where it does.
    """
    shares = {}
    for encoding, letters in _LETTERS.items():
        try:
            text = f" {content.decode(encoding)} "
        except UnicodeDecodeError:
            continue
        found = [
            _fits(text[place - 1], one, text[place + 1], letters)
            for place, one in enumerate(text)
            if not one.isascii()
        ]
        shares[encoding] = sum(found) / len(found)
    best = max(shares, key=lambda encoding: shares[encoding], default="")
    return best if best and shares[best] > _MOSTLY and not _CONTROL.search(content) else None


def _fits(before: str, one: str, after: str, letters: str) -> bool:
    """Whether a character fits between two others."""
    if one in "²³":
        return before.isalpha()
    if one in _SIGNS:
        return not (before.isalpha() and after.isalpha())
    alone = not (before + after).strip(" ;,\t\r\n")
    in_word = before.islower() or after.islower() or (one.isupper() and (before + after).isupper())
    return one in letters and (alone or in_word)


def _sixteen(head: bytes, path: str) -> str:
    """UTF-16 without a mark: every other byte of plain letters is 0."""
    for encoding, zeros in (("utf-16-le", head[1::2]), ("utf-16-be", head[::2])):
        if zeros.count(0) > 0.9 * len(zeros):
            return encoding
    raise InputError(
        f"{path} is a binary file, not text; save the table as comma-separated UTF-8 text."
    )
