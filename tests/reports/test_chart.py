"""Charts by themselves: what is drawn fits."""

import pytest

from mrp_sumo.reports.charts.chart import draw, key


@pytest.mark.parametrize("rows", [1, 3])
def test_labels_and_legend_fit_without_overlap(rows):
    figures = []

    def paint(figure):
        figures.append(figure)
        axes = figure.subplots(rows, 1, sharex=True, squeeze=False)[:, 0]
        for ax in axes:
            ax.plot([0, 1], [0, 123_456], label="a planner")
            ax.plot([0, 1], [123_456, 0], label="another planner")
            ax.set_yticks([0, 123_456], ["a long name of a robot", "0"])
            ax.set_ylabel("seconds")
        axes[-1].set_xlabel("robots")
        key(figure, axes[0])

    draw("name", "Title", "Caption.", paint)
    (figure,) = figures
    (legend,) = figure.legends
    drawn = [ax.get_tightbbox() for ax in figure.axes]
    for box in (*drawn, legend.get_window_extent()):
        assert box.x0 >= 0 and box.y0 >= 0 and box.x1 <= figure.bbox.x1 and box.y1 <= figure.bbox.y1
    for upper, lower in zip(drawn, [*drawn[1:], legend.get_window_extent()]):
        assert upper.y0 >= lower.y1
    assert all(ax.bbox.width > 0.5 * figure.bbox.width for ax in figure.axes)
