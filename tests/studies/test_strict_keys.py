"""Files are read strictly: what is misspelt, missing or impossible is named, in one line."""

import pytest
from pydantic import Field

from studies.files.strict import Strict, parse
from studies.files.study_error import StudyError, nearest, unknown
from studies.scenario.scenario import load_scenario


class Inner(Strict):
    length_m: float = Field(gt=0.0)


class Outer(Strict):
    inner: Inner
    items: tuple[Inner, ...] = ()
    speed_kmh: float = 0.0


def refusal(data) -> str:
    with pytest.raises(StudyError) as error:
        parse(Outer, data, "a.toml")
    text = str(error.value)
    assert "\n" not in text
    assert text.startswith("a.toml: ")
    return text


def test_a_misspelt_key_is_named_with_the_nearest_valid_one():
    assert "unknown key 'sped_kmh'; did you mean 'speed_kmh'?" in refusal(
        {"inner": {"length_m": 1.0}, "sped_kmh": 3.0}
    )


def test_a_misspelt_key_deep_inside_is_named_with_its_path_and_position():
    text = refusal({"inner": {"length_m": 1.0}, "items": [{"length_m": 1.0}, {"lenght_m": 2.0}]})
    assert "'items[2].lenght_m'; did you mean 'length_m'?" in text


def test_a_misspelt_key_comes_before_the_missing_one_it_stands_for():
    assert "did you mean 'length_m'?" in refusal({"inner": {"length": 1.0}})


def test_a_key_like_no_other_lists_the_valid_ones():
    assert "valid keys: inner, items, speed_kmh" in refusal({"inner": {"length_m": 1.0}, "zzz": 1})


def test_a_missing_key_is_named():
    assert refusal({}) == "a.toml: key 'inner' is missing"


@pytest.mark.parametrize(
    ("value", "words"),
    [(-1.0, "greater than 0"), ("long", "valid number"), (float("nan"), "finite number")],
)
def test_an_impossible_value_is_shown_with_the_reason(value, words):
    text = refusal({"inner": {"length_m": value}})
    assert f"key 'inner.length_m' = {value!r}: " in text
    assert words in text


def test_records_are_frozen():
    record = parse(Outer, {"inner": {"length_m": 1.0}}, "a.toml")
    with pytest.raises(ValueError, match="frozen"):
        record.speed_kmh = 1.0


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("duration_s", "durations_s", "unknown key 'durations_s'; did you mean 'duration_s'?"),
        ("level", "lvel", "unknown key 'rail.lvel'; did you mean 'level'?"),
        ("time_s", "tim_s", "unknown key 'command[1].tim_s'; did you mean 'time_s'?"),
        ("loss", "losses", "unknown key 'onboard.telegrams.losses'; did you mean 'loss'?"),
    ],
)
def test_a_misspelt_key_of_a_scenario_is_named(write_scenario, old, new, words):
    path = write_scenario(write_scenario.short, (f"\n{old} =", f"\n{new} ="))
    with pytest.raises(StudyError) as error:
        load_scenario(path)
    assert str(error.value) == f"{path}: {words}"


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("level = 0.05", "level = nan", "'rail.level'"),
        ("level = 0.05", "level = -0.1", "level = -0.1 must be"),
        ("duration_s = 2.0", "duration_s = 0.0", "'duration_s' = 0.0"),
        ("duration_s = 2.0", "duration_s = inf", "'duration_s' = inf"),
        ("commuter-8car", "comuter-8car", "did you mean 'commuter-8car'?"),
        ("loss = 0.1", "loss = 1.5", "loss = 1.5"),
        ('case = "A"', 'case = "C"', "'case' = 'C'"),
        ('train = "commuter-8car"', 'train = "commuter-8car"\nload_t = [1.0]', "load"),
        ("loss = 0.1", "loss = 0.1\n[onboard.braking.slide_protection]\nlaw = 'fuzy'", "'fuzy'"),
        ("title", "title = [", "is not TOML"),
        ("title", 'name = "../elsewhere"\ntitle', "key 'name' = '../elsewhere'"),
    ],
)
def test_an_impossible_scenario_is_refused_when_it_is_loaded(write_scenario, old, new, words):
    path = write_scenario(write_scenario.short, (old, new))
    with pytest.raises(StudyError) as error:
        load_scenario(path)
    assert words in str(error.value)
    assert "\n" not in str(error.value)


def test_a_negative_seed_is_refused(short):
    with pytest.raises(StudyError, match="seed = -1: must be 0 or greater"):
        short.event(-1)


def test_the_nearest_name_is_suggested_only_if_there_is_one():
    assert nearest("exat", ["exact", "qp"]) == "exact"
    assert nearest("zzz", ["exact", "qp"]) is None
    assert "did you mean" not in str(unknown("rule", "zzz", ["exact", "qp"]))
