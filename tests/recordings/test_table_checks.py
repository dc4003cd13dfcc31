"""Recordings that cannot be what their card says, and sound ones that look a little like them."""

import numpy as np
import pandas as pd
import pytest

from jaxmuscle.recordings import read

GAUGE = '"p_bar", unit = "bar", reference = "gauge"'
ABSOLUTE = '"p_bar", unit = "bar", reference = "absolute"'


def test_too_few_rows(lift) -> None:
    lift.change(lambda table: table.head(199))
    complaint = lift.complaint()
    assert "at least 200 rows" in complaint and "got 199" in complaint


def test_repeated_time(lift) -> None:
    lift.line(17, "0.028,5,0.2,0.1")
    complaint = lift.complaint()
    for word in ["lift.csv", "'t_s'", "row 17", "repeats", "0.028 s after 0.028 s"]:
        assert word in complaint


def test_reversed_time(lift) -> None:
    lift.line(17, "0.01,5,0.2,0.1")
    complaint = lift.complaint()
    for word in ["'t_s'", "row 17", "goes back", "0.01 s after 0.028 s"]:
        assert word in complaint


@pytest.mark.parametrize(("factor", "step"), [(1e4, "20 s"), (1e-4, "2e-07 s")])
def test_time_in_another_unit(lift, factor: float, step: str) -> None:
    lift.change(lambda table: table.assign(t_s=factor * table.t_s))
    complaint = lift.complaint()
    for word in ["'t_s'", f"sampling step of {step}", "really in 's'"]:
        assert word in complaint


def test_irregular_time(lift) -> None:
    lift.change(lambda table: table.drop(index=[1000, 3000, 3001]))
    complaint = lift.complaint()
    # Sample 3002, first after the longer gap, is the 3000th that is left, below the header.
    for word in ["'t_s'", "row 3001", "irregular", "0.006 s", "0.002 s", "2 steps", "--resample"]:
        assert word in complaint


def test_a_jitter_below_one_percent_is_no_irregularity(lift) -> None:
    jitter = 0.004 * 0.002 * np.random.default_rng(1).uniform(-1, 1, 6000)
    lift.change(lambda table: table.assign(t_s=table.t_s + jitter))
    recording = read(lift.table)
    assert len(recording) == 6000
    assert recording.step == pytest.approx(0.002, rel=1e-5)


@pytest.mark.parametrize("resample", [False, True])
def test_a_gap_that_cannot_be_bridged(lift, resample: bool) -> None:
    lift.change(lambda table: table.drop(index=range(3000, 3020)))
    complaint = lift.complaint(resample=resample)
    for word in ["row 3002", "0.042 s", "20 steps", "--stretch"]:
        assert word in complaint
    assert "--resample" not in complaint


@pytest.mark.parametrize("value", ["12.5", "0.001"])
def test_a_horizon_that_does_not_fit(lift, value: str) -> None:
    lift.write("horizon = { value = 1,", f"horizon = {{ value = {value},")
    complaint = lift.complaint()
    for word in ["lift.toml", "[fit] horizon", "lift.csv", f"got {value} s", "remove"]:
        assert word in complaint


def test_pressure_below_vacuum(lift) -> None:
    lift.change(lambda table: table.assign(p_bar=table.p_bar.where(table.index != 15, -1.2)))
    complaint = lift.complaint()
    for word in ["'p_bar'", "row 17", "below vacuum", "unit and reference"]:
        assert word in complaint
    assert "rather than" not in complaint


def test_gauge_pressures_marked_absolute(lift) -> None:
    lift.write(GAUGE, ABSOLUTE)
    complaint = lift.complaint()
    for word in ["'p_bar' (pressure)", "ambient", "is it gauge rather than absolute?"]:
        assert word in complaint


def test_absolute_pressures_marked_gauge(lift) -> None:
    lift.change(lambda table: table.assign(p_bar=1.01325 + 6.9 * table.p_bar / table.p_bar.max()))
    complaint = lift.complaint()
    for word in ["'p_bar' (pressure)", "supply", "8.013 bar", "is it absolute rather than gauge?"]:
        assert word in complaint


def test_a_muscle_that_is_filled_to_the_supply_pressure_is_sound(lift) -> None:
    lift.change(lambda table: table.assign(p_bar=7.02 * table.p_bar / table.p_bar.max()))
    assert read(lift.table).columns["pressure"].max() == pytest.approx(702000 + 101325)


def test_commands_to_a_regulator_may_ask_for_vacuum_but_not_less(swing) -> None:
    absolute = 'unit = "bar", reference = "absolute"'
    swing.write('"cmd1_bar", unit = "bar", reference = "gauge"', f'"cmd1_bar", {absolute}')
    swing.change(lambda table: table.assign(cmd1_bar=table.cmd1_bar.where(table.index != 15, 0.0)))
    assert read(swing.table).columns["command_1"].min() == 0.0
    swing.change(lambda table: table.assign(cmd1_bar=table.cmd1_bar.where(table.index != 15, -0.1)))
    complaint = swing.complaint()
    assert "'cmd1_bar' (command_1)" in complaint and "below vacuum" in complaint


def test_a_command_that_does_not_move(lift) -> None:
    lift.change(lambda table: table.assign(valve_V=5.0))
    complaint = lift.complaint()
    for word in ["'valve_V' (command)", "constant", "nothing to identify"]:
        assert word in complaint


def test_one_of_two_commands_may_rest(swing) -> None:
    swing.change(lambda table: table.assign(cmd1_bar=2.5))
    assert len(read(swing.table)) == 6000


def test_a_bench_that_does_not_move(bench) -> None:
    still = {"p_kPa": 200.0, "x_mm": 3.0}
    bench.change(lambda table: table.assign(x_mm=3.0))
    assert len(read(bench.table)) == 4000
    bench.change(lambda table: table.assign(**still))
    complaint = bench.complaint()
    for word in ["'p_kPa' (pressure)", "'x_mm' (position)", "nothing to identify"]:
        assert word in complaint


def test_a_dead_sensor(lift) -> None:
    lift.change(lambda table: table.assign(x_mm=0.25))
    complaint = lift.complaint()
    for word in ["'x_mm' (position)", "constant", "0.00025 m", "sensor"]:
        assert word in complaint


def test_all_suspicions_are_told_at_once(lift) -> None:
    def spoil(table: pd.DataFrame) -> pd.DataFrame:
        return table.assign(valve_V=5.0, x_mm=0.0, p_bar=-2.0)

    lift.change(spoil)
    complaint = lift.complaint()
    for word in [
        "4 problems",
        "below vacuum",
        "nothing to identify",
        "(position): constant",
        "(pressure): constant",
    ]:
        assert word in complaint
