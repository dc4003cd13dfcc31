"""Rig `driven` against its oracle."""

import numpy as np
import pytest
from oracles import bench
from oracles.driven import driven, lagged

EFFECTS = {
    "bare": {},
    "thread_friction": {"thread_friction": bench.THREADS},
    "bladder_stiffness": {"bladder_stiffness": bench.BLADDER},
    "bladder_hoop_stiffness": {"bladder_hoop_stiffness": bench.WALL},
    "pressure_dependent_ends": {"pressure_dependent_ends": bench.ENDS},
    "length_hysteresis": {"length_hysteresis": bench.LOOP},
    "together": {
        "thread_friction": bench.THREADS,
        "bladder_stiffness": bench.BLADDER,
        "pressure_dependent_ends": bench.ENDS,
        "length_hysteresis": bench.LOOP,
    },
}
CARRIED = tuple(EFFECTS["together"])
MOTION = bench.driven_motion()


@pytest.mark.parametrize("substeps", [1, 3])
@pytest.mark.parametrize("declared", EFFECTS.values(), ids=EFFECTS)
def test_equals_oracle(declared, substeps):
    force = driven(bench.CARDS["driven"], declared, *MOTION)
    actuator = bench.model("driven", CARRIED, **declared)
    readings = bench.simulated(actuator, bench.driven_track(*MOTION), substeps).readings
    # Both are algebraic in the samples and exact in the memories, so only rounding is left.
    np.testing.assert_allclose(readings["force"], force, rtol=1e-11, atol=1e-9)


@pytest.mark.parametrize("time_constant", [0.004, 0.05])
def test_lagging_sensor_equals_oracle(time_constant):
    truth = driven(bench.CARDS["driven"], {}, *MOTION)
    # From 200 to 400 steps a sample the oracle moves by 3e-8 of the range; the model is exact here.
    shown = lagged(truth, bench.STEPS["driven"], time_constant, substeps=200)
    actuator = bench.model("driven", force_sensor_lag={"time_constant": time_constant})
    readings = bench.simulated(actuator, bench.driven_track(*MOTION), 1).readings
    assert bench.deviation(truth, shown) > 5e-3
    assert bench.deviation(readings["force"], shown) < 2e-7


def test_creep_equals_oracle():
    creep = {"stiffness": 300.0, "fast_time": 0.1, "slow_time": 0.7}
    strain = MOTION[1] / bench.CARDS["driven"]["initial_length"]
    delayed = [lagged(strain, bench.STEPS["driven"], creep[name], 50) for name in ("fast_time", "slow_time")]
    force = driven(bench.CARDS["driven"], {}, *MOTION) - creep["stiffness"] * 0.5 * sum(delayed)
    readings = bench.simulated(bench.model("driven", creep=creep), bench.driven_track(*MOTION), 4).readings
    # From 4 to 8 steps a sample the model moves by 2e-7 of the range.
    assert bench.deviation(readings["force"], force) < 1e-6


def test_lagging_sensor_starts_at_the_force_of_the_other_effects():
    still = np.full(20, bench.AMBIENT + 2e5), np.full(20, 0.03), np.zeros(20)
    declared = {"bladder_stiffness": bench.BLADDER, "force_sensor_lag": {"time_constant": 0.05}}
    readings = bench.simulated(bench.model("driven", **declared), bench.driven_track(*still), 1).readings
    np.testing.assert_allclose(readings["force"], readings["force"][0], rtol=1e-12)
