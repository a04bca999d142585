"""Tables of the documentation: their numbers are those of committed CSV files.

A table whose numbers were measured has a comment before it that names its file and the file's columns:

    <!-- numbers: nvidia-h200/loads.csv: us_per_substep, us_without, ratio -->

Each number in the table, but for its first column, is a value of one of these columns, rounded as it is printed,
in any SI prefix or in percent. `a/b` is the quotient of two columns, row by row.
"""

import csv
import re
from decimal import Decimal
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
RESULTS = ROOT / "benchmarks" / "results"
MARK = re.compile(r"<!-- numbers: (\S+\.csv): ([^>]+?) -->\n+((?:\|.*\n)+)")
NUMBER = re.compile(r"(?<![\w.,])\d+(?: \d{3})*(?:\.\d+)?(?:e[-+]?\d+)?")
NOT_MEASURED = re.compile(r"·\s?10[⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+|\d+[²³]|`[^`]*`")  # a power of ten, a size such as 10³, code
SCALES = (0, 2, 3, -3, 6, -6, 9, -9)


def marked_tables():
    for page in [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]:
        text = page.read_text(encoding="utf-8")
        for n, (file, columns, table) in enumerate(MARK.findall(text)):
            yield pytest.param(file, columns.split(", "), table, id=f"{page.stem}-{n}-{Path(file).stem}")


def number(text):
    try:
        return abs(float(text.split(",")[0]))
    except ValueError:
        return None


def values(file, columns):
    """The values of some columns of a result; a sign is left to the table's words."""
    lines = (RESULTS / file).read_text(encoding="utf-8").splitlines()
    found = []
    for row in csv.DictReader(line for line in lines if not line.startswith("#")):
        for column in columns:
            parts = [number(row[part]) for part in column.split("/")]
            if None not in parts and (len(parts) == 1 or parts[1]):
                found.append(parts[0] if len(parts) == 1 else parts[0] / parts[1])
    return found


def printed(table):
    """The numbers of a table's cells, without its head and its first column."""
    for line in table.splitlines()[2:]:
        for cell in line.strip("|").split("|")[1:]:
            yield from (text.replace(" ", "") for text in NUMBER.findall(NOT_MEASURED.sub("", cell)))


def is_rounded_from(text, value):
    """Whether a value in some unit is rounded to a text. The last zeros of an integer may be rounding."""
    last = Decimal(text).as_tuple().exponent
    if last == 0 and len(text) > 2:
        last = len(text) - len(text.rstrip("0"))
    # Half of the last digit, and what a decimal loses as a float.
    return any(abs(value * 10.0**k - float(text)) <= 0.5 * 10.0**last * (1 + 1e-6) for k in SCALES)


@pytest.mark.parametrize(("file", "columns", "table"), list(marked_tables()))
def test_the_numbers_of_a_table_are_measured(file, columns, table):
    measured = values(file, columns)
    assert [text for text in printed(table) if not any(is_rounded_from(text, value) for value in measured)] == []


def test_a_wrong_number_is_found():
    assert is_rounded_from("12.3", 12.26)
    assert is_rounded_from("3600", 3566.0)
    assert not is_rounded_from("12.3", 12.36)
    assert not is_rounded_from("3610", 3566.0)
    assert list(printed("| a | b |\n|---|---|\n| 10 | 2.5 ms, 10³, 1 200 |\n")) == ["2.5", "1200"]
