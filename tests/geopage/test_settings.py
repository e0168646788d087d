# SPDX-License-Identifier: Apache-2.0
import pytest

from geopage.settings import PagerSettings, Throttle


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("threshold_px", 0.0),
        ("threshold_px", float("nan")),
        ("object_threshold_px", -1.0),
        ("budget_bytes", 0),
        ("policy", "fastest"),
        ("detail", "colour"),
        ("fade_s", -0.1),
        ("fade_s", float("nan")),
    ],
)
def test_a_setting_out_of_range_is_refused_with_its_value(name: str, value: object) -> None:
    with pytest.raises(ValueError, match=name) as caught:
        PagerSettings(**{name: value})  # type: ignore[arg-type]
    assert str(value) in str(caught.value)


@pytest.mark.parametrize("numbers", [(0.0, 0.0), (1.0, -1.0)])
def test_a_throttle_out_of_range_is_refused(numbers: tuple[float, float]) -> None:
    with pytest.raises(ValueError, match="throttle"):
        Throttle(*numbers)


def test_the_object_threshold_follows_the_threshold_unless_stated() -> None:
    assert PagerSettings(threshold_px=3.0).objects_px == 3.0
    assert PagerSettings(threshold_px=3.0, object_threshold_px=10.0).objects_px == 10.0
