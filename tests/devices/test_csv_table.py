"""Recorded hands in files as other programs write them: any separator, decimal commas, units in the names, any encoding."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cogrip.devices.simulated.csv_table import read_table, split_unit

from tests.devices.held_device import opened, refused

POSITIONS_MM = (0.0, 1.25, 4.5)


def positions(path: Path, keys: str, ticks: int = 3) -> list[float]:
    """Positions [m] of the first ticks at 1 kHz, from the first row's on."""
    device = opened(f"replay:{path}#{keys}", rate_hz=1000)
    return [sample.position_m[0] for tick in range(ticks) if (sample := device.read(tick)) is not None]


def table(path: Path, separator: str, decimal: str, names: tuple[str, str] = ("t [ms]", "x [mm]")) -> Path:
    rows = [(float(tick), position) for tick, position in enumerate(POSITIONS_MM)]
    lines = [names, *((f"{time:.3f}", f"{position:.4f}") for time, position in rows)]
    text = "\n".join(separator.join((first, second)) for first, second in lines).replace(".", decimal)
    path.write_text(text + "\n", encoding="utf-8")
    return path


@pytest.mark.parametrize("keys", ["time=t [ms]&x=x [mm]", "time=t&x=x", "time=t&x=x&scale=0.001&time_scale=0.001"])
@pytest.mark.parametrize(("separator", "decimal"), [(",", "."), (";", "."), (";", ","), ("\t", "."), ("\t", ",")])
def test_separator_decimal_comma_and_units_are_found(tmp_path: Path, separator: str, decimal: str, keys: str) -> None:
    path = table(tmp_path / "anna.csv", separator, decimal)
    assert positions(path, keys) == pytest.approx([1e-3 * each for each in POSITIONS_MM], abs=1e-12)


@pytest.mark.parametrize(
    ("names", "keys", "metres"),
    [
        (("t_ms", "x_mm"), "time=t_ms&x=x_mm", 1e-3),
        (("t_ms", "x_m"), "time=t_ms&x=x_m", 1.0),
        (("t (ms)", "x (cm)"), "time=t&x=x", 1e-2),
        (("t [ms]", "x [µm]"), "time=t&x=x", 1e-6),
        (("t [ms]", "x"), "time=t&x=x", 1.0),
        (("t [ms]", "x [rad]"), "time=t&x=x&scale=0.075", 0.075),
        (("t [ms]", "x [mm]"), "time=t&x=x&scale=0.01", 0.01),
    ],
)
def test_the_unit_is_that_of_the_name_unless_scale_says(
    tmp_path: Path, names: tuple[str, str], keys: str, metres: float
) -> None:
    path = table(tmp_path / "anna.csv", ";", ",", names)
    assert positions(path, keys) == pytest.approx([metres * each for each in POSITIONS_MM], abs=1e-12)


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "cp1252"])
def test_as_spreadsheets_write_it(tmp_path: Path, encoding: str) -> None:
    path = tmp_path / "anna.csv"
    path.write_bytes("Zeit [s];Größe [µm];\r\n0,000;0,0;\r\n0,001;1000,5;\r\n".encode(encoding))
    assert positions(path, "time=Zeit&x=Größe", 2) == pytest.approx([0.0, 1000.5e-6], abs=1e-12)


@pytest.mark.parametrize(
    ("text", "keys"),
    [
        ("0;0\n1;1,25\n2;4,5\n", "time=1&x=2"),
        ("0,0\n1,1.25\n2,4.5\n", "time=1&x=2"),
        ("0\t0\t7\n1\t1.25\t7\n2\t4.5\t7\n", "time=1&x=2"),
        ("# made by a logger, of anna\nt,x\n0,0\n# a pause\n1,1.25\n\n2,4.5\n#end\n", "time=t&x=x"),
        ("# anna\n# t [ms], x [mm]\n0,0\n1,1.25\n2,4.5\n", "time=t&x=x"),
        ("#t;x\n0;0\n1;1,25\n2;4,5\n", "time=t&x=x"),
        ("# no names\n0,0\n1,1.25\n2,4.5\n", "time=1&x=2"),
        ("0,1\n0,0\n1,1.25\n2,4.5\n", "time=0&x=1"),
        ("t,x\n0,0\n0,0\n1,1.25\n1,1.25\n1,1.25\n2,4.5\n", "time=t&x=x"),
    ],
)
def test_files_without_names_with_comments_and_with_rows_twice_are_read(tmp_path: Path, text: str, keys: str) -> None:
    path = tmp_path / "anna.csv"
    path.write_text(text)
    where = "" if "[mm]" in text else "&scale=0.001&time_scale=0.001"
    assert positions(path, keys + where) == pytest.approx([1e-3 * each for each in POSITIONS_MM], abs=1e-12)


@pytest.mark.parametrize(
    ("text", "keys", "said"),
    [
        ("0,0\n1,1\n", "time=t&x=x", ["no line with names, so that columns go by number", "'t'", "There are: 1, 2"]),
        ("0,5;0\n1,5;1\n", "time=t&x=x", ["read with a semicolon between columns", "There are: 1, 2"]),
        ("0,0\n1,1,2\n", "time=1&x=2", ["line 2: 3 cells, but 2 in the first row"]),
        ("t,x\n0,0\n1,1\n1,2\n", "time=t&x=x", ["line 4: t=1.0 stands in line 3 too, with another place", "coarse"]),
        (
            "t,x\n0,0\n1,1\n0,2\n",
            "time=t&x=x",
            ["line 4: t=0.0 is not after 1.0; if the file holds several recordings"],
        ),
        ("# t,x\n", "time=t&x=x", ["has 0 usable row"]),
        ("", "time=t&x=x", ["'t'"]),
        ("t;x [V]\n0;1\n1;2\n", "time=t&x=x", ["line 1, column 'x [V]'", "'V' is none of m, cm, mm", "scale=..."]),
        ("t [min];x\n0;1\n1;2\n", "time=t&x=x", ["line 1, column 't [min]'", "none of s, ", "time_scale=..."]),
        ("t;x\n0,5;1,5\n1,5;1.234,5\n", "time=t&x=x", ["line 3: x='1.234,5' is not a finite number"]),
        ("t;x\n0,5;1,5\n1,5;n/a\n", "time=t&x=x", ["line 3: x='n/a' is not a finite number"]),
        ("t,x\n0,5,1,5\n1,5,2,5\n", "time=t&x=x", ["line 2: 4 cells, but 2 column names", "put a semicolon"]),
        ("t;x\n0;1\n1;2;3\n", "time=t&x=x", ["line 3: 3 cells, but 2 column names in line 1"]),
        ("t;x [mm];x [V]\n0;1;1\n1;2;1\n", "time=t&x=x", ["unknown column 'x'", "x [mm], x [V]"]),
        ("t;x\n0;1\n1;2\n", "time=time&x=pos", ["read with a semicolon between columns", "'time'", "There are: t, x"]),
    ],
)
def test_what_cannot_be_read_is_said_with_line_and_column(
    tmp_path: Path, text: str, keys: str, said: list[str]
) -> None:
    path = tmp_path / "anna.csv"
    path.write_text(text)
    with refused("anna.csv", *said):
        positions(path, keys)


numbers = st.floats(-1e6, 1e6)


@given(st.lists(st.tuples(numbers, numbers), min_size=1, max_size=5), st.sampled_from([",.", ";.", ";,", "\t.", "\t,"]))
def test_any_numbers_come_back(
    tmp_path_factory: pytest.TempPathFactory, rows: list[tuple[float, float]], marks: str
) -> None:
    path = tmp_path_factory.getbasetemp() / "any.csv"
    lines = [marks[0].join(repr(each).replace(".", marks[1]) for each in row) for row in rows]
    path.write_text("\n".join([f"time{marks[0]}x [mm]", *lines]))
    found = read_table(str(path), ("time", "x"))
    assert found.separator == marks[0]
    line_numbers, cells = [line for line, _ in found.rows], [row for _, row in found.rows]
    assert line_numbers == list(range(2, len(rows) + 2))
    for place in (0, 1):
        assert found.numbers(cells, line_numbers, place) == [row[place] for row in rows]


def test_units_in_names() -> None:
    names = ("x [mm]", "x(mm)", "x", "x_mm", "f(x) [mm]")
    assert [split_unit(name) for name in names] == [
        ("x", "mm"), ("x", "mm"), ("x", ""), ("x_mm", ""), ("f(x)", "mm"),
    ]  # fmt: skip
