"""Encodings of one byte a character: short tables as spreadsheets in Europe write them."""

import io
import itertools
import random

import pytest

from adhesion_jax.data.dialect import encoding_of
from adhesion_jax.errors import InputError

HEADINGS = [
    "GPS Breite [°]",
    "GPS Länge [°]",
    "Höhe [m]",
    "Temperatur [°C]",
    "Überhöhung [mm]",
    "Krümmung [1/m]",
    "Beschleunigung [m/s²]",
    "Moment für Achse 1 [Nm]",
    "µ",
    "Größe",
    "µ ± 0,01",
    "vitesse à l'arrêt [km/h]",
]
PLAIN = ["Zeit [s]", "v_Rad [km/h]", "Zugkraft [kN]", "Schlupf [%]", "Sanden"]


def read(text, encoding):
    return encoding_of(io.BytesIO(text.encode(encoding)), "log.csv")


def test_the_short_tables_of_a_spreadsheet_are_cp1252():
    draw = random.Random(3)
    for count in (1, 2, 3):
        for names in itertools.combinations(HEADINGS, count):
            heading = [*names, *PLAIN]
            draw.shuffle(heading)
            text = ";".join(heading) + "\n" + ";".join("1,5" for _ in heading) + "\n"
            assert read(text, "cp1252") == "cp1252", heading


@pytest.mark.parametrize(
    ("text", "encoding"),
    [
        ("v;Temperatur [°C];µ\n", "cp850"),
        ("Länge [m];Krümmung\n", "cp850"),
        ("Länge [m];Krümmung [°]\n", "mac_roman"),
        ("Prędkość;siła styczna;współczynnik tarcia µ\n", "cp1250"),
        ("Скорость;сила\n", "cp1251"),
        ("kørsel;v [°];måling æble\n", "cp1252"),
        ("GRÖSSE;ÜBERHÖHUNG\n", "cp1252"),
    ],
)
def test_other_encodings_are_told_by_the_letters_they_give(text, encoding):
    assert read(text, encoding) == encoding


@pytest.mark.parametrize("content", [b"\x01\x02\xfc\xe4ab", bytes(range(128, 256)) * 3])
def test_what_is_no_text_is_refused(content):
    with pytest.raises(InputError, match=r"log\.csv is a binary file or text of an unknown"):
        encoding_of(io.BytesIO(content), "log.csv")
