"""The study of statistics past the horizon, in its quick setting."""

import re

import pytest

import clearjoint as cj
from studies.statistics import shadowing
from studies.statistics.__main__ import main
from studies.statistics.parts import FORCE, PERIOD

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("statistics")


@pytest.fixture(scope="module")
def lines(folder):
    return main(["--quick", "--output", str(folder)])


def test_the_quick_study_draws(lines, folder):
    for name in ("ensemble", "derivatives", "sensitivity"):
        assert (folder / f"{name}.png").stat().st_size > 3000
    assert len(lines) == 8 + 4 + 5


def test_intervals_hold_the_differences(lines):
    counts = [re.search(r"(\d+) of 3 intervals hold", line) for line in lines]
    held = [int(count[1]) for count in counts if count]
    assert len(held) == 3 and sum(held) >= 6


def test_the_clearance_drives_the_peak_of_the_first_revolution(lines):
    (line,) = [line for line in lines if line.startswith("first peak, total order")]
    shares = {name: float(share) for name, share in re.findall(r"(\w+) (-?[\d.]+) \(", line)}
    assert max(shares, key=lambda name: shares[name]) == "clearance"
    assert len(shares) == 5


def test_tangents_of_segments_agree_with_differences():
    clearance, step, after = 5e-5, 1e-10, 0.5 * PERIOD
    found = shadowing.segments(clearance, 1, PERIOD)
    assert len(found) > 1  # The tangents are continued from segment to segment.
    ends = cj.sweep(
        *cj.mechanisms.slider_crank(),
        PERIOD,
        {"clearance": cj.Axis(shadowing.CLEARANCE.variation, [clearance - step, clearance + step])},
        {"force": cj.Statistics(FORCE, "N", after=after)},
        cj.presets.derivatives,
        progress=False,
    )["force_mean"].values
    derivative = shadowing.mean_force(found, shadowing.continued(found), after)
    assert derivative == pytest.approx((ends[1] - ends[0]) / (2.0 * step), rel=1e-2)
