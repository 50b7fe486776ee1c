"""However a logger writes a number, a text or an axle's name, it is read as what was meant."""

import zipfile

import numpy as np
import pandas as pd
import pytest

from studies.files.study_error import StudyError
from studies.logs.mapping import SI, factor, kinds_of, registry, told_by_names
from studies.logs.measured_log import read_log
from studies.logs.own_samples import _gained, numbers
from studies.logs.recorder_files import decimal_of, encoding_of, numbers_of, read_recording
from studies.logs.train import MeasuredTrain
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


def test_every_writing_of_a_number_is_that_number_and_every_other_text_is_none():
    for decimal, write in WRITINGS.values():
        texts = [write(value) for value in NUMBERS]
        assert decimal_of([texts]) == decimal
        found = numbers_of(np.array(texts, dtype=object), decimal)
        assert (found.wrong, sum(found.words.values())) == (None, 0)
        np.testing.assert_allclose(found.values, NUMBERS, atol=0.51)
    # three decimals are no groups
    assert decimal_of([["0,120", "12,345", "-1,000"]]) == ","
    assert decimal_of([["12,345", "13,456"], ["0,5", "1,5"]]) == ","
    for text in ("1:20", "12 5", "1.2.3", "0x1F", "1_000", "12,34,5"):
        with pytest.raises(StudyError, match=r"row 2: .* is not a number"):
            numbers(np.array(["1.0", text, "2.0"], dtype=object), "v", "log")
    for text in ("Bad", "1.#QNAN", "-1.#IND", "?", "#VALUE!", "axle1_speed"):
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


def test_an_encoding_is_told_by_its_bytes():
    for text, encoding in (
        ("Zeit;v über Grund;Längskraft [kN]", "cp1252"), ("temps écoulé;n° essieu", "latin-1"),
        ("時刻[s],列車速度[km/h],軸1速度", "cp932"), ("時刻,列車速度", "utf-8"), ("ﾊﾟﾙｽ,時刻,速度", "cp932"),
        ("time;µ [-];speed", "cp1252"), ("time;v", "utf-16-le"), ("time;v", "utf-16-be"), ("time;v", "utf-16"),
    ):  # fmt: skip
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


COUNTED = {
    "through the train": "axle {n} speed [km/h]", "from 0": "nAxle{z} [1/min]", "short, in cars": "W{c}_RS{k}_v_kmh",
    "cars by letters": "Car {l} Axle {k} speed [km/h]", "cars, and through": "Car {c} Axle {n} speed [km/h]",
    "Japanese, in cars": "{c}号車 第{k}軸速度[km/h]", "bogies of a car": "Car {c} Bogie {b} Axle {s} speed [km/h]",
    "bogies of the train": "Drehgestell {t} Radsatz {s} Geschwindigkeit", "alone": "v{n}", "array": "vWheel[{z}]",
    "a field of structs": "log.axle {n}.speed", "of a matrix": "wheel_speed_kmh {n}", "with a unit behind": "v_RS_{n}_rpm",
}  # fmt: skip


@pytest.mark.parametrize("way", COUNTED)
def test_axles_are_found_however_they_are_counted_in_any_order(way):
    for axles in (4, 4, 4), (4, 4), (4, 2, 4), (6, 4):
        train, names, t = train_of(*axles), [], 0
        for i, car in enumerate(train.axle_car.tolist()):
            k = i - int((train.axle_car < car).sum())
            t += k % 2 == 0
            told = {"n": i + 1, "z": i, "c": car + 1, "l": "ABC"[car], "k": k + 1, "t": t}
            names.append(COUNTED[way].format(**told, b=k // 2 + 1, s=k % 2 + 1))
        shuffled = np.random.default_rng(len(axles)).permutation(names).tolist()
        found = told_by_names(dict.fromkeys(["Zeit", *shuffled], ""), train)
        assert found.pop("Zeit").stem == "time"
        assert [found[name].number for name in names] == list(range(1, sum(axles) + 1))
        assert {told.stem for told in found.values()} == {"axleN_speed"}


MEANT = {
    "motor 1 speed [rpm]": ("axleN_speed", "gear_ratio"), "TM1 torque [Nm]": ("axleN_torque", "gear_ratio"),
    "Bremszylinderdruck Achse 1 [bar]": ("axleN_pressure", "newton_per_kpa"),
    "Impulse RS 1": ("axleN_pulses", "pulses_per_turn"),
    "Kupplungskraft 1 [kN]": ("couplerK_force", ""), "Druck Wagen 1 [bar]": ("carK_pressure", ""),
    "a_car1": ("carK_acceleration", ""), "Neigung [‰]": ("gradient", ""), "キロ程[km]": ("position", ""),
    "couple essieu n° 1 (N.m)": ("axleN_torque", ""), "T_Achslager_1": None, "current [A]": None, "yaw rate [deg/s]": None,
    "brake notch": None, "line voltage [V]": None, "x [9**9**9]": None,
}  # fmt: skip


def test_a_name_means_one_thing_or_nothing():
    for name, meant in MEANT.items():
        told = told_by_names({name: ""}, train_of(4, 4)).get(name)
        assert (told and (told.stem, told.needs)) == meant, name


@pytest.mark.parametrize(
    ("turn", "signed"), [(100, 0), (256, 0), (256, 1), (1000, 0), (4096, 0), (65536, 1)]
)
def test_a_counter_that_begins_anew_goes_on(turn, signed):
    time = 0.02 * np.arange(2000)
    total = np.floor(np.cumsum(9.0 + 6.0 * np.sin(0.3 * time)))
    count = total % turn - (turn // 2 if signed else 0)
    gained, _ = _gained(time, count)
    assert gained.sum() == pytest.approx(total[-1] - total[0], rel=0.01)


def test_every_unit_that_the_library_has_of_a_quantity_is_that_unit():
    library, count = registry(), 0
    for kind, si in SI.items():
        if kind in ("turning", "pulses", "slope"):
            continue
        for unit in map(str, library.get_compatible_units(library.Unit(si).dimensionality)):
            count += 1
            # the library's own units of a quantity, with a prefix and with the worth of a digit
            for text, scale in (
                (unit, 1.0),
                (f"[{unit}]", 1.0),
                (f"kilo{unit}", 1e3),
                (f"0.01 {unit}", 0.01),
            ):
                one = scale * library.Quantity(1.0, unit).to(si).magnitude
                assert factor(text, kind) == pytest.approx(one, rel=1e-12), text
                assert kind in kinds_of(text)
    assert count > 80


LOGGERS = {
    "speed": "km/h kmh KM/H kph Km/h 0.277777777778; mph MPH mile/h 0.44704; kn kt knots 0.514444444444; m/s ms M/S 1",
    "turning": "1/min U/min rpm RPM r/min min-1 min^-1 umin 0.104719755120; Hz 1/s s-1 6.28318530718; rad/s rads 1",
    "force": "N n 1; kN KN kn 1e3; MN 1e6; mN 1e-3; daN dan 10; kgf kp 9.80665; lbf 4.4482216152605",
    "torque": "Nm NM N*m N·m N.m 1; kNm kN.m KNM 1e3; ft*lbf 1.3558179483314",
    "pressure": "bar Bar BAR 1e5; kPa KPA 1e3; MPa 1e6; mbar hPa 1e2; kgf/cm2 kgf/cm² kg/cm2 98066.5; psi PSI 6894.7572932",
    "acceleration": "m/s2 m/s² m/s^2 m/s**2 m·s⁻² ms2 1; km/h/s 0.277777777778; g 9.80665",
    "time": "s S sec 1; ms 1e-3; us µs μs 1e-6; h 3600",
    "slope": "‰ permille mm/m 1e-3; % percent 0.01; m/m - 1", "position": "m M 1; km KM 1e3; ft 0.3048",
    "pulses": "imp counts - 1",
}  # fmt: skip
"""By kind of quantity: units, and what they are worth."""


def test_units_are_read_as_loggers_write_them():
    for kind, written in LOGGERS.items():
        for line in written.split(";"):
            *texts, worth = line.split()
            scale = eval(worth, {"pi": np.pi})
            assert [factor(text, kind) for text in texts] == pytest.approx([scale] * len(texts), rel=1e-9), line  # fmt: skip
    for text, kind in (
        ("kN", "torque"),
        ("bar", "force"),
        ("A", "time"),
        ("9**9**9", "slope"),
        ("km", "speed"),
    ):
        assert factor(text, kind) is None


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
