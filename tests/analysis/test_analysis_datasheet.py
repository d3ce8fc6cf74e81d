"""The datasheet's numbers against the measured ones, and whose convention is whose."""

import numpy as np
import pytest

from allanscope.analysis.datasheet import compare, published_density, published_rms, rms_of
from allanscope.errors import UsageError
from allanscope.noise import Coefficient
from allanscope.parts import ACCEL_SCALES, GYRO_SCALES, PARTS, full_scale_of, part_named
from allanscope.spectrum import Density


def white(value, spread=0.01, unit="dps/sqrt(Hz)", detected=True):
    return Coefficient(value, value * (1 - spread), value * (1 + spread), unit, detected)


DSM = part_named("LSM6DSM")


@pytest.mark.parametrize(
    ("one_sided", "verdict"),
    [(3.8e-3, "typical"), (2.5e-3, "better"), (6e-3, "worse"), (4.4e-3, "typical")],
)
def test_the_one_sided_density_is_compared(one_sided, verdict):
    found = compare(DSM, "gx", white(one_sided / np.sqrt(2)), rate_hz=104.0, full_scale=250.0)
    density = found["density"]
    assert density.verdict == verdict
    assert density.limit == 3.8e-3
    assert density.measured == pytest.approx(one_sided)
    assert "one-sided" in density.explanation
    assert "sqrt(2) N" in density.explanation


def test_a_gyro_is_compared_at_whatever_full_scale_and_an_accelerometer_is_not():
    """The gyro's noise does not depend on it, and a log in dps does not tell it."""
    found = compare(DSM, "gx", white(2.7e-3), rate_hz=104.0, full_scale=None)
    assert found == compare(DSM, "gx", white(2.7e-3), rate_hz=104.0, full_scale=250.0)
    assert compare(DSM, "ax", white(6e-5), rate_hz=104.0, full_scale=None) == {}


def test_both_readings_and_the_angle_after_an_hour_are_given():
    details = compare(DSM, "gz", white(4e-3), rate_hz=104.0, full_scale=125.0)["density"].details
    assert details["dt0064_density"] == 4e-3
    assert details["dt0064_ratio"] == pytest.approx(4 / 3.8)
    assert details["ratio"] == pytest.approx(np.sqrt(2) * 4 / 3.8)
    # ARW sqrt(t): 0.24 deg/sqrt(h) over one hour.
    assert details["arw_deg_per_sqrt_hour"] == pytest.approx(0.24)
    assert details["angle_after_one_hour_deg"] == pytest.approx(4e-3 * np.sqrt(3600))
    words = compare(DSM, "gz", white(4e-3), rate_hz=104.0, full_scale=125.0)["density"].explanation
    assert "ARW sqrt(time): 0.24 deg after one hour" in words
    assert "0.228 for the datasheet's density as DT0064 reads it" in words


def test_a_wide_interval_is_not_a_verdict_against_the_part():
    vague = white(5e-3, spread=0.8)
    found = compare(DSM, "gx", vague, rate_hz=104.0, full_scale=250.0)["density"]
    assert found.verdict == "typical"


@pytest.mark.parametrize(("full_scale", "limit"), [(2.0, 90e-6), (16.0, 130e-6)])
def test_accelerometers_have_a_density_for_each_full_scale(full_scale, limit):
    found = compare(DSM, "az", white(60e-6), rate_hz=104.0, full_scale=full_scale)["density"]
    assert found.limit == limit
    assert found.unit == "g/sqrt(Hz)"
    assert "ug/sqrt(Hz)" in found.explanation
    assert "arw_deg_per_sqrt_hour" not in found.details


def test_what_is_not_published_is_said_to_be_so():
    found = compare(PARTS["LSM6DS3H"], "gx", white(4e-3), rate_hz=104.0, full_scale=250.0)
    assert found["density"].verdict == "not published"
    assert found["density"].limit is None
    assert found["density"].measured == pytest.approx(4e-3 * np.sqrt(2))
    assert published_rms(PARTS["LSM6DS3H"], "ax", 2.0) is None


@pytest.mark.parametrize("unknown", [None, white(1e-3, detected=False)])
def test_before_the_white_noise_is_known_there_is_no_verdict(unknown):
    found = compare(DSM, "gx", unknown, rate_hz=104.0, full_scale=250.0)["density"]
    assert found.verdict == "not known yet"
    assert found.measured is None


def test_slow_modes_are_judged_by_their_rms():
    options = {"rate_hz": 52.0, "full_scale": 4.0}
    found = compare(DSM, "ax", white(1e-4), rms=2.1e-3, **options)["rms"]
    assert found.verdict == "typical"
    assert found.limit == 2.0e-3
    assert found.unit == "g"
    assert found.details["equivalent_density"] == pytest.approx(2e-3 / np.sqrt(26))
    assert "if the part runs in low-power mode" in found.explanation
    assert "2.1 mg against 2 typical" in found.explanation
    assert compare(DSM, "ax", None, **options)["rms"].verdict == "not known yet"
    none = compare(PARTS["LSM6DS3H"], "ax", None, rms=1.0, **options)["rms"]
    assert none.verdict == "not published"


def test_parts_beyond_the_three_have_scales_and_a_source_and_are_marked():
    three = {"LSM6DS3H", "LSM6DSL", "LSM6DSM"}
    assert {name for name, part in PARTS.items() if not part.beyond} == three
    for name, part in PARTS.items():
        assert part.name == name
        assert part.source
        assert list(part.gyro_scales) == sorted(part.gyro_scales)
        assert (4000.0 in part.gyro_scales) <= part.beyond
        assert part.beyond <= (part.cutoffs_hz("gx", 208.0) == ())
    assert PARTS["LSM6DSV16X"].gyro_scale(4000.0) == 0.14
    assert full_scale_of("gx", 0.14) == 4000.0
    with pytest.raises(UsageError, match="no gyro full scale of 4000 dps"):
        PARTS["LSM6DSM"].gyro_scale(4000.0)


def test_a_verdict_by_figures_at_second_hand_says_that_nobody_verified_them():
    quoted = {name for name, part in PARTS.items() if part.second_hand}
    assert quoted == {"ISM330DHCX", "LSM6DSV"}
    for name, part in PARTS.items():
        if part.gyro_density is not None:
            verdict = compare(part, "gx", white(4e-3), rate_hz=104.0, full_scale=250.0)["density"]
            said = f"not verified in the datasheet: {part.source}" in verdict.explanation
            assert said == (name in quoted)


@pytest.mark.parametrize(
    ("rate_hz", "modes"),
    [(12.5, {"density", "rms"}), (208.0, {"density", "rms"}), (416.0, {"density"})],
)
def test_both_modes_are_judged_where_the_rate_leaves_them_open(rate_hz, modes):
    for part in (one for one in PARTS.values() if not one.beyond):
        for axis, scales in (("gy", GYRO_SCALES), ("az", ACCEL_SCALES)):
            for full_scale in scales:
                found = compare(
                    part, axis, white(1e-3), rate_hz=rate_hz, full_scale=full_scale, rms=0.05
                )
                assert set(found) == modes
                for verdict in found.values():
                    published = part.name != "LSM6DS3H"
                    assert (verdict.limit is not None) == published
                    assert (verdict.verdict == "not published") != published
                    assert verdict.unit.partition("/")[0] == ("dps" if axis == "gy" else "g")


def test_the_rms_is_that_of_the_samples_without_drift():
    f = np.array([0.01, 0.3, 10.0, 40.0])
    width = np.array([0.01, 0.2, 10.0, 50.0])
    density = Density(f, width, np.array([1e6, 2.0, 3.0, 4.0]), np.ones(4))
    assert rms_of(density) == pytest.approx(np.sqrt(0.4 + 30 + 200))
    assert rms_of(Density(f[:1], width[:1], f[:1], f[:1])) is None


def test_a_step_that_hides_the_noise_gets_no_praise():
    found = compare(
        DSM, "gx", white(1e-3), rate_hz=104.0, full_scale=2000.0, rms=0.01, step_limited=True
    )
    assert {verdict.verdict for verdict in found.values()} == {"hidden by the step"}
    assert "describe quantization" in found["density"].explanation


def test_limits_are_in_the_unit_of_the_axis_and_say_what_white_noise_they_mean():
    found = compare(DSM, "gx", white(4e-3), rate_hz=104.0, full_scale=250.0)["density"]
    assert (found.limit, found.unit) == (3.8e-3, "dps/sqrt(Hz)")
    assert found.white_limit == pytest.approx(3.8e-3 / np.sqrt(2))
    none = compare(PARTS["LSM6DS3H"], "gx", white(4e-3), rate_hz=104.0, full_scale=250.0)
    assert none["density"].white_limit is None


def test_modes_and_filters_follow_the_rate():
    assert DSM.mode(104.0) == "high-performance"
    assert DSM.mode(52.0, high_performance=False) == "low-power"
    assert DSM.mode(208.0, high_performance=False) == "normal"
    assert DSM.mode(833.0, high_performance=False) == "high-performance"
    assert DSM.cutoffs_hz("gx", 6500.0) == (937.0, 351.0, 237.0, 173.0)
    assert DSM.cutoffs_hz("gy", 104.0) == pytest.approx((33.28,))
    assert max(DSM.cutoffs_hz("az", 104.0)) == 26.0


def test_full_scales_follow_from_the_scale():
    assert full_scale_of("gz", 70e-3) == 2000.0
    assert full_scale_of("ay", 0.122e-3) == 4.0
    assert full_scale_of("ay", 0.122) is None
    assert published_density(DSM, "ax", 3.0) is None
    with pytest.raises(UsageError):
        part_named("MPU6050")
