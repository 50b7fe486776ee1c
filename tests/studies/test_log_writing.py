"""However a logger writes a number, a text or an axle's name, it is read as what was meant."""

import zipfile

import numpy as np
import pandas as pd
import pytest

from studies.files.study_error import StudyError
from studies.logs.axle_series import _gained, _since_row_before
from studies.logs.columns import factor
from studies.logs.channel_values import numbers
from studies.logs.columns import told_by_names
from studies.logs.known_train import MeasuredTrain
from studies.logs.measured_log import read_log

from studies.logs.recorder_files import decimal_of, encoding_of, numbers_of, read_recording

from tests.studies.test_log_files import TABLE, TRAIN

NUMBERS = np.random.default_rng(11).normal(0.0, 3000.0, 400)
WRITINGS = {
    "point": (".", lambda v: f"{v:.3f}"),
    "comma": (",", lambda v: f"{v:.3f}".replace(".", ",")),
    "English groups": (".", lambda v: f"{v:,.2f}"),
    "German groups": (",", lambda v: f"{v:,.2f}".replace(",", "_").replace(".", ",").replace("_", ".")),
    "Swiss groups": (".", lambda v: f"{v:,.2f}".replace(",", "'")),
    "thin blanks": (",", lambda v: f"{v:,.2f}".replace(",", "\u202f").replace(".", ",")),
    "Fortran": (".", lambda v: f"{v:.9E}".replace("E", "D")),
    "groups alone": (".", lambda v: f"{round(v):,}"),
    "points alone": (",", lambda v: f"{round(v):,}".replace(",", ".")),
}  # fmt: skip


@pytest.mark.parametrize("name", WRITINGS)
def test_every_writing_of_a_number_is_that_number(name):
    decimal, write = WRITINGS[name]
    texts = [write(value) for value in NUMBERS]
    assert decimal_of([texts]) == decimal
    found = numbers_of(np.array(texts, dtype=object), decimal)
    assert (found.wrong, sum(found.words.values())) == (None, 0)
    np.testing.assert_allclose(found.values, NUMBERS, atol=0.51)


def test_three_decimals_are_no_groups():
    assert decimal_of([["0,120", "12,345", "-1,000"]]) == ","
    assert decimal_of([["12,345", "13,456"], ["0,5", "1,5"]]) == ","


@pytest.mark.parametrize("text", ["1:20", "12 5", "1.2.3", "0x1F", "1_000", "12,34,5"])
def test_what_is_no_number_is_refused_and_not_left_out(text):
    with pytest.raises(StudyError, match=r"row 2: .* is not a number"):
        numbers(np.array(["1.0", text, "2.0"], dtype=object), "v", "log")


@pytest.mark.parametrize("text", ["Bad", "1.#QNAN", "-1.#IND", "?", "#VALUE!", "axle1_speed"])
def test_words_are_no_value_and_said(text):
    values, said = numbers(np.array(["1.0", text, "2.0"], dtype=object), "v", "log")
    np.testing.assert_array_equal(values, [1.0, np.nan, 2.0])
    assert repr(text) in said[0].text


@pytest.mark.parametrize("none", [-9999.0, 9999.0, 6553.5, 1e30])
def test_a_number_far_from_all_others_stands_for_none(none):
    speed = np.linspace(100.0, 0.0, 200)
    speed[::17] = none
    values, said = numbers(speed, "v", "log")
    assert np.isnan(values[::17]).all()
    assert np.isfinite(np.delete(values, np.s_[::17])).all()
    assert len(said) == 1
    # a wheel that locks from full speed has no such value
    locked = np.where(np.arange(200) > 100, 0.0, np.linspace(100.0, 80.0, 200))
    assert numbers(locked, "v", "log")[1] == []


@pytest.mark.parametrize(
    ("text", "encoding"),
    [
        ("Zeit;v über Grund;Längskraft [kN]", "cp1252"), ("temps écoulé;n° essieu", "latin-1"),
        ("時刻[s],列車速度[km/h],軸1速度", "cp932"), ("時刻,列車速度", "utf-8"), ("ﾊﾟﾙｽ,時刻,速度", "cp932"),
        ("time;µ [-];speed", "cp1252"), ("time;v", "utf-16-le"), ("time;v", "utf-16-be"), ("time;v", "utf-16"),
    ],
)  # fmt: skip
def test_an_encoding_is_told_by_its_bytes(text, encoding):
    written = (text + "\n1;2;3\n" * 20).encode(encoding)
    assert written.decode(encoding_of(written)).lstrip("\ufeff").startswith(text)


def train_of(*axles: int) -> MeasuredTrain:
    """A train of cars with so many axles."""
    count = sum(axles)
    return MeasuredTrain(
        name="cars", car_mass=np.full(len(axles), 40e3), axle_car=np.repeat(np.arange(len(axles)), axles),
        axle_load=np.full(count, 9e4), radius=np.full(count, 0.43), inertia=np.full(count, 80.0),
        driven=np.ones(count, dtype=bool),
    )  # fmt: skip


def _names(train: MeasuredTrain, write) -> list[str]:
    found = []
    for i, car in enumerate(train.axle_car.tolist()):
        own = i - int((train.axle_car < car).sum())
        found.append(write(i, car, own))
    return found


@pytest.mark.parametrize("axles", [(4, 4, 4), (4, 2, 4), (6, 4)])
@pytest.mark.parametrize(
    "write",
    [
        lambda i, car, own: f"axle {i + 1} speed [km/h]",
        lambda i, car, own: f"nAxle{i} [1/min]",
        lambda i, car, own: f"W{car + 1}_RS{own + 1}_v_kmh",
        lambda i, car, own: f"Car {'ABC'[car]} Axle {own + 1} speed [km/h]",
        lambda i, car, own: f"Car {car + 1} Axle {i + 1} speed [km/h]",
        lambda i, car, own: f"{car + 1}号車 第{own + 1}軸速度[km/h]",
    ],
)
def test_axles_are_found_however_they_are_counted(axles, write):
    train = train_of(*axles)
    names = _names(train, write)
    found = told_by_names(dict.fromkeys(names, ""), train)
    assert [found[name].number for name in names] == list(range(1, sum(axles) + 1))


def test_axles_count_within_the_bogies_of_a_car():
    train = train_of(4, 4)
    names = _names(
        train, lambda i, c, k: f"Car {c + 1} Bogie {k // 2 + 1} Axle {k % 2 + 1} speed [km/h]"
    )
    found = told_by_names(dict.fromkeys(names, ""), train)
    assert [found[name].number for name in names] == list(range(1, 9))


def test_a_motor_is_no_wheel():
    names = ["motor 1 speed [rpm]", "motor 1 torque [Nm]"]
    assert guess(names, dict.fromkeys(names, ""), set(), train_of(4)) == {}


@pytest.mark.parametrize(
    ("turn", "signed"), [(100, 0), (256, 0), (256, 1), (1000, 0), (4096, 0), (65536, 1)]
)
def test_a_counter_that_begins_anew_goes_on(turn, signed):
    time = 0.02 * np.arange(2000)
    total = np.floor(np.cumsum(9.0 + 6.0 * np.sin(0.3 * time)))
    count = total % turn - (turn // 2 if signed else 0)
    assert not _since_row_before(count)
    gained, _ = _gained(time, count)
    assert gained.sum() == pytest.approx(total[-1] - total[0], rel=0.01)
    assert _since_row_before(np.diff(total))


def test_units_may_have_the_worth_of_a_digit():
    assert factor("0.01 km/h", "speed") == pytest.approx(0.01 / 3.6)
    assert factor("knots", "speed") == pytest.approx(1852.0 / 3600.0)
    assert factor("kgf/cm2", "pressure") == pytest.approx(98066.5)
    assert factor("1/min", "turning") == pytest.approx(2.0 * np.pi / 60.0)


def test_a_zip_has_one_table(tmp_path):
    path = tmp_path / "log.zip"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("export/run.csv", TABLE.to_csv(index=False))
        archive.writestr("export/readme.md", "nothing")
    assert read_log(path, TRAIN).rows == len(TABLE)
    with zipfile.ZipFile(path, "a") as archive:
        archive.writestr("second.csv", "a,b")
    with pytest.raises(StudyError, match="2 tables of text"):
        read_log(path, TRAIN)
    path.write_bytes(b"no zip")
    with pytest.raises(StudyError, match="no file of zip"):
        read_log(path, TRAIN)


TIMES = {
    "days of a spreadsheet": lambda s: 46100.25 + s / 86400.0,
    "whole microseconds": lambda s: np.round(1e6 * s).astype(np.int64),
    "minutes and seconds": lambda s: [f"{int(t // 60):02d}:{t % 60:06.3f}" for t in s + 50.0],
    "nanoseconds since 1970": lambda s: np.round(1e9 * s).astype(np.int64) + 1_790_000_000_000_000_000,
}  # fmt: skip


@pytest.mark.parametrize("name", TIMES)
def test_every_clock_gives_the_same_instants(tmp_path, name):
    path = tmp_path / "log.csv"
    told = TABLE.assign(time_s=TIMES[name](TABLE["time_s"].to_numpy())).rename(
        columns={"time_s": "Time"}
    )
    told.to_csv(path, index=False)
    time = read_log(path, TRAIN).run.time
    np.testing.assert_allclose(time - time[0], TABLE["time_s"], atol=2e-3)


def test_headings_and_summaries_between_rows_are_left_out(tmp_path):
    lines = TABLE.to_csv(index=False).splitlines()
    lines.insert(300, lines[0])
    lines += [f"{word},{lines[1].partition(',')[2]}" for word in ("Min", "Max", "Mean")]
    (tmp_path / "log.csv").write_text("\n".join(lines))
    log = read_log(tmp_path / "log.csv", TRAIN)
    assert log.rows == len(TABLE)
    assert any("4 rows without a time" in remark.text for remark in log.remarks)


def test_an_index_of_instants_is_the_time(tmp_path):
    own = TABLE.drop(columns="time_s")
    for k, index in enumerate(
        (pd.to_timedelta(TABLE["time_s"], unit="s"), pd.Timestamp("2026-02-02", tz="Asia/Tokyo")
         + pd.to_timedelta(TABLE["time_s"], unit="s"))
    ):  # fmt: skip
        own.set_index(pd.Index(index, name="elapsed")).to_parquet(tmp_path / f"{k}.parquet")
        time = read_log(tmp_path / f"{k}.parquet", TRAIN).run.time
        np.testing.assert_allclose(time - time[0], TABLE["time_s"], atol=1e-6)


def test_groups_name_their_channels_and_begin_when_they_say(tmp_path):
    tdms = pytest.importorskip("nptdms")
    begin = np.datetime64("2026-05-05T10:00:00", "us")
    with tdms.TdmsWriter(tmp_path / "log.tdms") as writer:
        writer.write_segment(
            [
                tdms.ChannelObject(
                    group, "Speed", np.arange(50.0),
                    {"wf_increment": 0.02, "wf_samples": 1, "wf_start_offset": 0.0, "unit_string": "km/h",
                     "wf_start_time": begin + np.timedelta64(late, "ms")},
                )
                for group, late in (("Axle 2", 500), ("Axle 1", 0))
            ]
        )  # fmt: skip
    channels = read_recording(tmp_path / "log.tdms").channels
    assert sorted(channels) == ["Axle 1 Speed", "Axle 2 Speed"]
    assert channels["Axle 1 Speed"].clock[0] == 0.0
    assert channels["Axle 2 Speed"].clock[0] == pytest.approx(0.5)
