"""Hypothesis strategies for what users write: cards, tables, arguments, gains and options of commands."""

import copy
import gzip
import io
import tomllib

import numpy as np
import tomlkit
from hypothesis import strategies as st

import jaxmuscle as jm
from jaxmuscle.actuators import RIGS
from jaxmuscle.recordings import schema

SAMPLES = ("lift", "swing", "bench")
CARDS = {name: jm.sample(name).with_suffix(".toml").read_text(encoding="utf-8") for name in SAMPLES}
ODD_NUMBERS = [0, -1, 1e-320, 1e308, -1e308, 10**400, -(10**400), 2**63, float("nan"), float("inf"), 0.5, 7]
ODD_UNITS = [
    "bar",
    "barg",
    "bar(a)",
    "mm",
    "mm^2",
    "°C",
    "degC",
    "delta_degC",
    "1/0",
    "m**m",
    "bar bar",
    "m^9999999999",
    "2**2**2**99",
    "m/",
    "/s",
    "()",
    "(",
    "%",
    "1e999",
    "dBm",
    "[bar]",
    "m\x00",
    "0 m",
    "nan",
    "ppm",
    "Ω",
    "_",
    "m^0.5",
    "m**(1/0)",
    "-m",
    "kg m^2/s^2",
    "percent",
    "count",
    "pint",
    "__class__",
    "m.n",
    "lambda: 1",
    "µm",
]
ODD_TEXTS = [
    "",
    " ",
    "?",
    "isotonic",
    "joint",
    "lift",
    "gauge",
    "absolute",
    "\x00",
    "\ud7ff",
    "a" * 300,
    "á",
    "\n",
]
NAMES = sorted(
    {
        name
        for rig in RIGS.values()
        for name in (*schema.quantities(rig), *schema.columns(rig), *rig.states, *rig.outputs)
    }
)


def numbers():
    """Finite ones, and what is none or beyond all bounds."""
    return st.sampled_from(ODD_NUMBERS) | st.floats() | st.integers()


def texts():
    return st.sampled_from(ODD_TEXTS) | st.sampled_from(NAMES) | st.text(max_size=12)


def units():
    letters = st.text(alphabet="mkgsNPabrVdeg^*/()-+.0123456789 _µ°²", max_size=10)
    return st.sampled_from(ODD_UNITS) | letters | st.text(max_size=5)


def anything():
    """What a TOML or a call may hold in the place of something else."""
    leaves = st.none() | st.booleans() | numbers() | texts() | units()
    deeper = lambda inner: st.lists(inner, max_size=3) | st.dictionaries(texts(), inner, max_size=3)  # noqa: E731
    return st.recursive(leaves, deeper, max_leaves=4)


def _places(node, path=()):
    yield path
    if isinstance(node, dict):
        for key, inner in node.items():
            yield from _places(inner, (*path, key))


PARSED = {name: tomllib.loads(text) for name, text in CARDS.items()}
PLACES = {name: [path for path in _places(card) if path] for name, card in PARSED.items()}


@st.composite
def card_mappings(draw):
    """A card of the package of which a few entries are something else, are gone or have another name."""
    name = draw(st.sampled_from(SAMPLES))
    card = copy.deepcopy(PARSED[name])
    for _ in range(draw(st.integers(1, 3))):
        path = draw(st.sampled_from(PLACES[name]))
        node = card
        for key in path[:-1]:
            node = node.get(key) if isinstance(node, dict) else None
        if not isinstance(node, dict) or path[-1] not in node:
            continue
        what = draw(st.sampled_from(["value", "value", "unit", "remove", "rename", "add"]))
        if what == "remove":
            del node[path[-1]]
        elif what == "rename":
            node[draw(texts())] = node.pop(path[-1])
        elif what == "add":
            node[draw(texts())] = draw(anything())
        else:
            node[path[-1]] = draw(units() if what == "unit" else anything())
    return card


@st.composite
def mangled(draw, text):
    """A text of which pieces are cut out, doubled or replaced."""
    for _ in range(draw(st.integers(1, 4))):
        begin = draw(st.integers(0, max(len(text) - 1, 0)))
        end = min(begin + draw(st.integers(0, 30)), len(text))
        piece = draw(
            st.sampled_from(["", text[begin:end] * 2, '"', "=", "[", "]]", "{", "\n", ",", ";", "1e9999"])
        )
        piece = piece or draw(st.text(max_size=4))
        text = text[:begin] + piece + text[end:]
    return text


def card_texts():
    return st.sampled_from(SAMPLES).flatmap(lambda name: mangled(CARDS[name]))


def toml_of(mapping):
    """The TOML text of a mapping; `None` when TOML cannot hold it."""
    try:
        return tomlkit.dumps(mapping)
    except Exception:
        return None


FIELDS = [
    "0",
    "1",
    "-1.5",
    "1,5",
    "1e3",
    "1e999",
    "nan",
    "",
    " ",
    "x",
    "#",
    '"',
    "'a b'",
    "12:00:00",
    "2026-03-01T12:00:00",
    "0x10",
    "1_000",
    "True",
    "-",
    "é",
    "\t",
    "1;2",
    "=1+1",
    "\x00",
    "9" * 40,
    "inf",
    "2026-13-45T99:99:99",
    "25:61",
]


@st.composite
def table_texts(draw):
    """A delimited text as some program may write it: a head, rows of numbers, and faults here and there."""
    separator = draw(st.sampled_from([",", ";", "\t", "|", " ", ", "]))
    width = draw(st.integers(1, 6))
    head = draw(
        st.lists(
            st.sampled_from(["t_s", "valve_V", "p_bar", "x_mm", "t", "Zeit [s]", "", "1", "t_s"]) | texts(),
            min_size=width,
            max_size=width,
        )
    )
    rows = draw(st.integers(0, 12))
    step = draw(st.sampled_from([0.002, 0, 1, -0.1]))
    body = [[f"{i * step:g}", *(f"{i * k % 7}" for k in range(1, width))] for i in range(rows)]
    for _ in range(draw(st.integers(0, 3)) if rows else 0):
        row, column = draw(st.integers(0, rows - 1)), draw(st.integers(0, width - 1))
        body[row][column] = draw(st.sampled_from(FIELDS) | st.text(max_size=4))
    lines = [separator.join(line) for line in [head, *body]]
    if draw(st.booleans()):
        extra = st.sampled_from(
            ["# remark", "[s];[V]", "s,V,bar,mm", "", "%", "//", separator * 5]
        ) | st.text(max_size=8)
        lines.insert(draw(st.integers(0, len(lines))), draw(extra))
    return draw(st.sampled_from(["\n", "\r\n", "\r"])).join(lines)


def _packed(content):
    return gzip.compress(content, mtime=0)


def _arrays(kind):
    """A file of NumPy's of a small table."""
    buffer = io.BytesIO()
    if kind == ".npy":
        np.save(buffer, np.zeros(8, [("t_s", float), ("x", float)]))
    else:
        np.savez(buffer, t_s=np.arange(8.0), x=np.ones(8))
    return buffer.getvalue()


@st.composite
def table_files(draw):
    """(name, bytes) of a table that may be cut, mangled, or something else altogether."""
    ending = draw(st.sampled_from([".csv", ".csv", ".csv", ".txt", ".csv.gz", ".npy", ".npz", ".mat"]))
    if ending in (".npy", ".npz"):
        content = _arrays(ending)
    else:
        coded = draw(st.sampled_from(["utf-8", "utf-8-sig", "utf-16", "latin-1"]))
        content = draw(table_texts()).encode(coded, errors="replace")
        content = _packed(content) if ending == ".csv.gz" else content
    harm = draw(st.sampled_from(["none", "none", "cut", "change", "other"]))
    if harm == "cut":
        content = content[: draw(st.integers(0, len(content)))]
    elif harm == "change" and content:
        at = draw(st.integers(0, len(content) - 1))
        content = content[:at] + draw(st.binary(min_size=1, max_size=4)) + content[at + 1 :]
    elif harm == "other":
        content = draw(st.binary(max_size=60))
    return f"table{ending}", content


def options():
    """The right-hand side of ``--over``, ``--set``, ``--start``, ``--stretch`` and the like."""
    words = st.sampled_from(
        ["mass", "command.mean", "pressure", "velocity", "end_factor", "effects.creep.force", "="]
    )
    rest = st.lists(
        st.sampled_from(
            ["1", "2:5", "1:2:3", "log", "bar", "gauge", "kg", ",", "nan", "1e400", "-", "+-1", "all"]
        )
        | units()
        | numbers().map(str),
        max_size=4,
    )
    form = st.tuples(words | texts(), st.sampled_from(["=", "", "=="]), rest, st.sampled_from([":", ","]))
    return form.map(lambda parts: parts[0] + parts[1] + parts[3].join(parts[2])) | st.text(max_size=12)


OF_PID = ("proportional", "integral", "derivative", "smoothing")


def gains():
    """Arguments of a PID, names of gains to be tuned and their bounds."""
    names = st.sampled_from(["proportional", "integral", "derivative", "smoothing", "x", "proportional[0]"])
    pair = st.tuples(numbers() | st.none(), numbers() | st.none()) | anything()
    return st.fixed_dictionaries(
        {
            "controller": st.dictionaries(names.filter(lambda n: n in OF_PID), numbers(), max_size=4),
            "free": st.none() | st.lists(names | texts(), max_size=3) | anything(),
            "bounds": st.none() | st.dictionaries(names | texts(), pair, max_size=2) | anything(),
        }
    )


@st.composite
def recordings(draw):
    """Arguments of `jm.recording`."""
    rows = draw(st.sampled_from([0, 1, 2, 30]))
    fine = {
        "command": np.sin(np.arange(rows)),
        "pressure": np.full(rows, 2e5) + np.arange(rows),
        "position": 1e-3 * np.arange(rows),
    }
    for _ in range(draw(st.integers(0, 2))):
        key = draw(st.sampled_from([*fine, "x", ""]))
        other = draw(
            anything()
            | st.lists(numbers(), max_size=4)
            | st.just(np.zeros((2, 2)))
            | st.just(np.full(rows, np.nan))
        )
        fine[key] = other
    few = st.sampled_from(["pressure", "position", "command", "mass", "valve_area", "x"])
    return {
        "columns": draw(st.just(fine) | anything()) if draw(st.integers(0, 9)) == 0 else fine,
        "step": draw(st.sampled_from([0.002, 0.002, 1]) | numbers() | anything()),
        "noise": draw(st.none() | st.dictionaries(few, numbers() | anything(), max_size=2)),
        "horizon": draw(st.none() | numbers() | anything()),
        "breaks": draw(st.just(()) | st.lists(st.integers(-2, 40), max_size=3) | anything()),
        "uncertain": draw(st.none() | st.dictionaries(few, numbers() | anything(), max_size=2)),
        "stretch": draw(st.none() | options() | st.tuples(numbers(), numbers()) | anything()),
        "every": draw(st.none() | st.integers(-1, 40) | anything()),
    }
