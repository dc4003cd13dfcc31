"""Delimited texts of any dialect give the samples of the plain one, and what is ambiguous is refused."""

import gzip
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from jaxmuscle.errors import InputError
from jaxmuscle.recordings import read
from jaxmuscle.recordings.readers import read_table
from jaxmuscle.recordings.readers.dialect import dialect_of
from jaxmuscle.samples import sample

NAMES = ("t_s", "valve_V", "p_bar", "x_mm")
ROWS = [line.split(",") for line in sample("lift").read_text().splitlines()[1:301]]
VALUES = np.array(ROWS, dtype=float)
SEPARATORS = [",", ";", "\t", "|", " "]


def text_of(separator: str, comma: str = ".", names=NAMES, rows=ROWS) -> str:
    lines = [separator.join(field.replace(".", comma) for field in row) for row in rows]
    return "\n".join([separator.join(names), *lines]) + "\n"


def table(text: str | bytes, name: str = "lift.csv"):
    content = text.encode("utf-8") if isinstance(text, str) else text
    return read_table(Path(name), content)


def assert_whole(found, names=NAMES, rtol: float = 0.0) -> None:
    assert list(found.columns) == list(names)
    for name, values in zip(names, VALUES.T, strict=True):
        np.testing.assert_allclose(found.numbers(name), values, rtol=rtol, atol=0)


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
@pytest.mark.parametrize("comma", [".", ","])
@pytest.mark.parametrize("separator", SEPARATORS)
def test_every_separator_and_decimal_sign(separator: str, comma: str, end: str) -> None:
    if (separator, comma) == (",", ","):
        return
    found = table(text_of(separator, comma).replace("\n", end))
    assert_whole(found)
    assert found.row(0) == 2


HEADERS = {
    "commas": ["time, s", "valve, V", "pressure, bar", "position, mm"],
    "one comma": ["t_s", "valve_V", "p_bar", "position, mm"],
    "mixed": ["time, s", "valve; V", "p\tbar", "x|mm"],
    "all semicolons": ["t;s", "valve;V", "p;bar", "x;mm"],
    "words": ["the time", "voltage of the valve", "p", "x"],
}


@pytest.mark.parametrize("comma", [".", ","])
@pytest.mark.parametrize("separator", SEPARATORS[:4])
@pytest.mark.parametrize("header", HEADERS)
def test_names_in_quotes_hold_any_separator(header: str, separator: str, comma: str) -> None:
    names = HEADERS[header]
    if (separator, comma) == (",", ","):
        return
    assert_whole(table(text_of(separator, comma, [f'"{name}"' for name in names])), names)


@pytest.mark.parametrize("comma", [".", ","])
@pytest.mark.parametrize("separator", [";", "\t"])
def test_a_comma_in_a_name_needs_no_quotes_where_it_separates_nothing(separator: str, comma: str) -> None:
    assert_whole(table(text_of(separator, comma, HEADERS["commas"])), HEADERS["commas"])


def test_a_comma_in_a_name_without_quotes_between_commas_is_refused() -> None:
    with pytest.raises(
        InputError,
        match=r"lift.csv: row 1 holds 5 names, the rows below fewer fields, most of them 4; .*in quotes",
    ):
        table(text_of(",", names=["t_s", "valve_V", "p_bar", "position, mm"]))


def test_decimal_commas_between_commas_within_quotes() -> None:
    rows = [[f'"{field.replace(".", ",")}"' for field in row] for row in ROWS]
    assert_whole(table(text_of(",", rows=rows)))


def test_decimal_commas_that_come_late() -> None:
    """Integers tell nothing of the sign."""
    rows = [[str(i), "5", "1", "0"] for i in range(400)] + [["400,5", "5", "1,5", "-0,25"]]
    found = table(text_of(";", rows=rows))
    assert found.numbers("t_s")[-1] == 400.5 and found.numbers("x_mm")[-1] == -0.25


def test_points_here_and_commas_there_are_refused() -> None:
    rows = [*ROWS[:100], ["0,2", "5", "1,5", "0,1"]]
    with pytest.raises(
        InputError, match=r"lift.csv: .*semicolons.* with points \('0.*'\) and with commas \('"
    ):
        table(text_of(";", rows=rows))


def test_marks_for_thousands_are_refused() -> None:
    rows = [*[[field.replace(".", ",") for field in row] for row in ROWS], ["1.000,5", "5", "1", "2"]]
    with pytest.raises(InputError, match=r"row 302: expected a number; got '1.000,5'"):
        table(text_of(";", rows=rows)).numbers("t_s")


@pytest.mark.parametrize("mark", ["#", "%", "//", "  # "])
def test_comment_lines_above_and_between(mark: str) -> None:
    lines = text_of(";", ",").splitlines()
    lines[100:100] = [f"{mark} paused; and went on; 1,5; 2", f"{mark} twice"]
    lines = [f"{mark} bench 3", f"{mark} operator; date; 1; 2", *lines]
    found = table("\n".join(lines))
    assert_whole(found)
    assert [found.row(i) for i in (0, 98, 99, 299)] == [4, 102, 105, 305]


def test_a_row_is_counted_as_in_the_file_below_comments() -> None:
    lines = text_of(",").splitlines()
    lines[5:5] = ["# one", "# two"]
    lines[20] = "0.03,5,fault,0.1"
    with pytest.raises(InputError, match="row 21: expected a number; got 'fault'"):
        table("\n".join(lines)).numbers("p_bar")


def test_names_in_a_comment_line_as_numpy_writes_them(tmp_path: Path) -> None:
    file = tmp_path / "lift.txt"
    np.savetxt(file, VALUES, delimiter=";", header="bench 3\nt_s;valve_V;p_bar;x_mm")
    found = read_table(file, file.read_bytes())
    assert_whole(found, rtol=1e-15)  # NumPy writes more digits than pandas rounds correctly.
    assert found.row(0) == 3


def test_a_column_that_is_called_by_a_mark() -> None:
    for name in ("#", "%RH"):
        assert_whole(table(text_of(",", names=[name, *NAMES[1:]])), [name, *NAMES[1:]])


def test_remarks_above_the_names() -> None:
    found = table("Bench 3\n\nSampling rate;500;Hz\nChannels;4\n" + text_of(";", ","))
    assert_whole(found)
    assert found.row(0) == 6


@pytest.mark.parametrize(
    "units", [["s", "V", "bar", "mm"], ["[s]", "(V)", "", "[mm]"], ["s", "-", "barg", "µm"]]
)
@pytest.mark.parametrize(("separator", "comma"), [(",", "."), (";", ",")])
def test_units_below_the_names(units: list[str], separator: str, comma: str) -> None:
    found = table(text_of(separator, comma).replace("\n", f"\n{separator.join(units)}\n", 1))
    assert_whole(found)
    assert found.row(0) == 3
    bare = {name: unit.strip("[]()-") for name, unit in zip(NAMES, units, strict=True)}
    assert dict(found.units) == {name: unit for name, unit in bare.items() if unit}


def test_units_that_contradict_the_card(lift) -> None:
    lift.line(1, "t_s,valve_V,p_bar,x_mm\ns,V,kPa,mm")
    assert "'p_bar' (pressure): the table gives its unit as 'kPa', the card as 'bar'" in lift.complaint()
    lift.line(2, "s,V,bar(a),mm")
    assert "which is absolute; the card says reference = 'gauge'" in lift.complaint()
    lift.line(2, "s,V,barg,mm")
    np.testing.assert_array_equal(
        read(lift.table).columns["pressure"], read(sample("lift")).columns["pressure"]
    )


def test_every_line_may_end_with_a_separator() -> None:
    assert_whole(table(text_of(";", ",").replace("\n", ";\n")))
    assert_whole(table(text_of(";", ",").replace("\n", ";\n").replace(";\n", "\n", 1)))


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "utf-16-le", "cp1252"])
def test_what_windows_writes(encoding: str) -> None:
    names = [*NAMES[:3], "Länge µm"]
    mark = b"\xff\xfe" if encoding == "utf-16-le" else b""
    assert_whole(table(mark + text_of("\t", ",", names).encode(encoding)), names)


def test_compressed_and_with_its_card(lift) -> None:
    packed = lift.table.with_name("lift.csv.gz")
    packed.write_bytes(gzip.compress(lift.table.read_bytes()))
    whole, recording = read(lift.table), read(packed)
    assert recording.name == "lift" and recording.sha256 != whole.sha256
    np.testing.assert_array_equal(recording.columns["position"], whole.columns["position"])
    packed.write_bytes(packed.read_bytes()[:5000])
    with pytest.raises(InputError, match=r"lift.csv.gz: cannot be unpacked by gzip"):
        read(packed)


STAMPS = {
    "T and zone": "2026-03-01T23:59:59.500Z",
    "blank": "2026-03-01 23:59:59.500",
    "comma": "2026-03-01 23:59:59,500",
    "offset": "2026-03-01T23:59:59.500+01:00",
    "time of day": "11:59:59.500",
    "midnight": "23:59:55.250",
}


@pytest.mark.parametrize("separator", [";", "\t"])
@pytest.mark.parametrize("kind", STAMPS)
def test_iso_time_stamps_are_seconds_from_the_first(lift, kind: str, separator: str) -> None:
    first = STAMPS[kind]
    begin, steps = pd.Timestamp(first.replace(",", ".")), pd.to_timedelta(np.arange(6000) * 0.002, unit="s")
    time = [(begin + step).isoformat(timespec="milliseconds") for step in steps]
    if kind in ("time of day", "midnight"):
        time = [stamp.partition("T")[2] for stamp in time]
    if kind in ("blank", "comma"):
        time = [stamp.replace("T", " ") for stamp in time]
    if kind == "comma":
        time = [stamp.replace(".", ",") for stamp in time]
    frame = pd.read_csv(lift.table).assign(t_s=time)
    frame.to_csv(lift.table, index=False, sep=separator)
    recording = read(lift.table)
    np.testing.assert_allclose(recording.time, 0.002 * np.arange(6000), rtol=0, atol=1e-9)
    lift.write('column = "t_s", unit = "s"', 'column = "t_s", unit = "ms"')
    assert "holds time stamps, which are read as seconds" in lift.complaint()


def test_a_time_stamp_that_is_none(lift) -> None:
    stamps = [f"2026-03-01T12:00:{0.002 * i:06.3f}" for i in range(6000)]
    stamps[16] = "later"
    lift.change(lambda frame: frame.assign(t_s=stamps))
    assert "row 18: expected a time stamp as in the rows before" in lift.complaint()


def test_no_line_of_names() -> None:
    with pytest.raises(InputError, match="lift.csv: no line of names: the first line holds numbers"):
        table("\n".join(text_of(",").splitlines()[1:]))


@pytest.mark.parametrize("text", ["", "\n\n", "# nothing\n"])
def test_nothing_in_it(text: str) -> None:
    with pytest.raises(InputError, match="it is empty"):
        table(text)


def test_many_random_tables_keep_their_layout() -> None:
    """Whatever is written is read back, or the writer's own dialect is refused with a message."""
    random = np.random.default_rng(0)
    for _ in range(100):
        columns, decimals = int(random.integers(2, 9)), int(random.integers(0, 5))
        separator = SEPARATORS[random.integers(1, 4)]
        comma = ".,"[random.integers(2)]
        numbers = random.normal(scale=10.0 ** random.integers(-3, 4), size=(30, columns)).round(decimals)
        names = [
            f"{random.choice(list('tpxFuθ'))}{i}, {random.choice(['s', 'bar', 'mm'])}" for i in range(columns)
        ]
        rows = [[f"{x:.{decimals}f}" for x in row] for row in numbers]
        if random.random() < 0.2:
            rows = [[f"{x:.3e}" for x in row] for row in numbers]
        found = table(text_of(separator, comma, names, rows))
        assert list(found.columns) == names
        expected = np.array(rows, dtype=float)
        np.testing.assert_array_equal(np.array([found.numbers(n) for n in names]).T, expected)


def test_the_dialect_says_what_it_saw() -> None:
    seen = dialect_of(["# bench", "time;p", "s;bar", "0;1,5", "1;2,5"])
    assert (seen.separator, seen.decimal, seen.names, seen.units) == (";", ",", ("time", "p"), ("s", "bar"))
    assert (seen.header, seen.first) == (1, 3)
