"""Names stand beside their own line, on no other line and on no other name."""

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.transforms import Bbox

from paper_figs.direct_labels import label_lines
from paper_figs.style import COLUMN, STYLE_FILE

X = np.linspace(0.0, 10.0, 300)
SHAPES = {
    "parallel": {"low": 0.2 * X, "high": 0.2 * X + 3.0},
    "crossing": {"up": X, "down": 10.0 - X},
    "steep": {"falling": np.exp(-X), "rising": 1.0 - np.exp(-X)},
    "together, then apart": {"stays": 0.0 * X, "leaves": np.maximum(X - 7.0, 0.0)},
    "swings": {"slow": 4.0 + np.sin(X), "fast": np.sin(9.0 * X)},
    "alone": {"only": X**2},
}


@pytest.fixture(params=SHAPES)
def panel(request):
    with mpl.rc_context(fname=STYLE_FILE):
        figure = Figure(figsize=(COLUMN.value, 2.2), layout="constrained")
        axes = figure.subplots()
        for name, values in SHAPES[request.param].items():
            axes.plot(X, values, label=name)
        axes.axhline(-0.5, label="_bound")
        label_lines(axes)
        figure.draw_without_rendering()
    return axes


def distance(box: Bbox, line, axes) -> float:
    """Least distance of a line from a box [pixels]; 0 where it crosses."""
    points = axes.transData.transform(np.column_stack(line.get_data()))
    fine = np.arange(0.0, len(points) - 1, 0.05)
    points = np.column_stack([np.interp(fine, np.arange(len(points)), p) for p in points.T])
    outside = np.maximum(np.maximum([box.x0, box.y0] - points, points - [box.x1, box.y1]), 0.0)
    return float(np.hypot(*outside.T).min())


def test_a_name_is_nearest_to_its_own_line_and_crosses_none(panel):
    lines = {line.get_label(): line for line in panel.get_lines()}
    names = {text.get_text(): text.get_window_extent() for text in panel.texts}
    assert set(names) == {name for name in lines if not name.startswith("_")}
    for name, box in names.items():
        away = {other: distance(box, line, panel) for other, line in lines.items()}
        assert min(away.values()) > 0.0
        assert min(away, key=away.get) == name
        assert panel.bbox.x0 <= box.x0 < box.x1 <= panel.bbox.x1
        assert panel.bbox.y0 <= box.y0 < box.y1 <= panel.bbox.y1


def test_names_do_not_meet_each_other_or_a_note():
    with mpl.rc_context(fname=STYLE_FILE):
        figure = Figure(figsize=(COLUMN.value, 1.2), layout="constrained")
        axes = figure.subplots()
        for k in range(4):
            axes.plot(X, 0.02 * k + 0.0 * X, label=f"line number {k}")
        axes.text(5.0, 0.07, "a note that was there before")
        label_lines(axes)
        figure.draw_without_rendering()
    boxes = [text.get_window_extent() for text in axes.texts]
    for k, one in enumerate(boxes):
        assert all(Bbox.intersection(one, other) is None for other in boxes[:k])


def test_a_line_without_numbers_has_no_name():
    axes = Figure().subplots()
    axes.plot([], [], label="nothing")
    axes.plot([0.0, 1.0], [np.nan, np.nan], label="unknown")
    axes.plot([0.0, 1.0], [0.0, 1.0], label="line")
    label_lines(axes)
    assert [text.get_text() for text in axes.texts] == ["line"]
