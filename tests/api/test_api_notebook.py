"""A result and a curve as a notebook shows them, and tables of other libraries as input."""

import sys
import types
from dataclasses import replace

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.figure import Figure

from allanscope import AllanBank, analyse, deviation
from allanscope.pipeline.columns import columns_of_table
from support.demo_analysis import demo_analysis

mpl.use("Agg")


@pytest.fixture(scope="module")
def analysis():
    return demo_analysis(7300.0)


@pytest.fixture
def pandas(monkeypatch):
    """Stand in for the library: a table is the dict that it was made of."""
    monkeypatch.setitem(sys.modules, "pandas", types.SimpleNamespace(DataFrame=dict))


def curve_of(columns):
    noise = np.random.default_rng(1).normal(size=(4000, columns))
    if columns == 1:
        return deviation(noise[:, 0], 100.0)
    bank = AllanBank(100.0, axes=columns)
    bank.update(noise)
    return bank.deviation("oadev")


def test_the_summary_begins_with_the_verdict_and_has_every_axis(analysis):
    lines = analysis.summary().splitlines()
    assert lines[0].startswith("LSM6DSM, 2 h 1 min, 48 648 660 samples, lost samples: 1 998")
    assert [line.partition(":")[0] for line in lines[1:4]] == [
        "Noisier than the datasheet",
        "Partly unexplained on az",
        "Keep recording",
    ]
    (gx,) = [line for line in lines if line.startswith("gx")]
    assert gx.split()[1:4] == ["2.900", "[2.874,", "2.926]"]
    assert "Lost samples: 1 998 (0.0041 %)" in lines


def test_html_of_a_result_escapes_what_a_device_says(analysis):
    hostile = replace(analysis, part="<script>", remarks=("<img src=x>",))
    page = hostile._repr_html_()
    assert "<script>" not in page
    assert "<img" not in page
    assert page.count("<table>") == 2


def test_a_curve_is_drawn_with_its_limits_and_the_untrusted_end_dotted():
    ax = Figure().subplots()
    curve = curve_of(1)
    assert curve.plot(ax, factor=1e3, unit="mdps", label="gx") is ax
    assert (ax.get_xscale(), ax.get_yscale()) == ("log", "log")
    solid, dotted = ax.lines
    np.testing.assert_allclose(solid.get_ydata(), 1e3 * curve.deviation[curve.trusted])
    assert (solid.get_label(), dotted.get_linestyle()) == ("gx", ":")
    assert len(solid.get_xdata()) + len(dotted.get_xdata()) == len(curve.tau) + 1
    assert "mdps" in ax.get_ylabel()


def test_a_curve_as_a_table_has_units_and_no_exponents():
    page = deviation(np.random.default_rng(1).normal(size=20_000), 100.0)._repr_html_()
    assert page.count("<th>tau, s</th>") == 1
    assert "e+" not in page
    assert "<td>yes</td>" in page
    assert "<td>no</td>" in page


def test_a_curve_that_is_not_trusted_at_either_end_is_dotted_there_alone():
    noise = np.random.default_rng(2).normal(size=4000)
    curve = deviation(noise, 100.0, "theobr")
    assert not curve.trusted[0]
    assert curve.trusted[-3]
    curve.trusted[-2:] = False
    first, last = np.flatnonzero(curve.trusted)[[0, -1]]
    solid, short, long = curve.plot(Figure().subplots()).lines
    np.testing.assert_allclose(solid.get_xdata(), curve.tau[first : last + 1])
    np.testing.assert_allclose(short.get_xdata(), curve.tau[: first + 1])
    np.testing.assert_allclose(long.get_xdata(), curve.tau[last:])


def test_a_curve_of_several_axes_is_drawn_as_several():
    ax = curve_of(3).plot(Figure().subplots())
    assert [one.get_label() for one in ax.lines if one.get_label()[0] != "_"] == [
        "oadev 0",
        "oadev 1",
        "oadev 2",
    ]


def test_a_result_is_drawn_one_chart_a_sensor(analysis):
    figure = analysis.plot()
    assert [ax.get_title() for ax in figure.axes] == ["Gyroscope, OADEV", "Accelerometer, OADEV"]
    names = [text.get_text() for ax in figure.axes for text in ax.get_legend().get_texts()]
    assert names == list(analysis.axes)
    with pytest.raises(ValueError, match="no curve 'nonsense'"):
        analysis.plot("nonsense")


def test_tables_have_a_row_for_each_coefficient_and_each_tau(analysis, pandas):
    table = analysis.to_dataframe()
    assert len(table["axis"]) == sum(len(one.coefficients) for one in analysis.axes.values())
    first = table["coefficient"].index("N")
    assert table["value"][first] == analysis.axes["gx"].coefficients["N"].value
    curve = curve_of(2)
    rows = curve.to_dataframe()
    assert set(rows["axis"]) == {0, 1}
    assert len({len(column) for column in rows.values()}) == 1


def test_without_any_table_library_the_error_names_one(monkeypatch):
    for name in ("pandas", "polars"):
        monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(ImportError, match="pip install pandas"):
        curve_of(1).to_dataframe()


class Array(types.SimpleNamespace):
    """What an array of xarray offers."""

    @property
    def ndim(self):
        return self.values.ndim


def labelled(values, name="", units="", **coords):
    dims = ("time", "axis")[: values.ndim]
    return Array(values=values, name=name, attrs={"units": units}, coords=coords, dims=dims)


def test_arrays_with_labels_bring_names_units_and_times():
    time = labelled(np.array([0, 10, 20], "M8[ms]"))
    names = labelled(np.array(["ax", "gx"]))
    columns = columns_of_table(
        labelled(np.arange(6.0).reshape(3, 2), units="", time=time, axis=names), None
    )
    assert {k: v.tolist() for k, v in columns.axes.items()} == {"gx": [1, 3, 5], "ax": [0, 2, 4]}
    assert columns.time_s.tolist() == [0.0, 0.01, 0.02]
    one = columns_of_table(labelled(np.arange(3.0), "gy", "mdps", t=labelled(np.arange(3.0))), None)
    assert (dict(one.units), one.time_s.tolist()) == ({"gy": "mdps"}, [0.0, 1.0, 2.0])


def test_a_dataset_and_a_table_are_mappings_of_columns():
    class Dataset(dict):
        data_vars = property(dict.keys)
        coords = types.MappingProxyType({})

    columns = columns_of_table(Dataset(az=labelled(np.array([998.0, 1002.0]), "az", "mg")), None)
    assert dict(columns.units) == {"az": "mg"}

    class Frame(dict):
        columns = property(list)

    table = columns_of_table(Frame({"gx[dps]": [1.0, 2.0]}), None)
    assert table.axes["gx"].tolist() == [1.0, 2.0]


class Column:
    """What a Series of pandas or polars offers; that of polars has no index."""

    def __init__(self, values, name=None, **more):
        self.values, self.name = np.asarray(values), name
        vars(self).update(more)

    def __array__(self, dtype=None, copy=None):
        return np.asarray(self.values, dtype)

    def to_numpy(self):
        return self.values


DATES = np.array(["2026-01-01T12:00:00.00", "2026-01-01T12:00:00.01", "2026-01-01T12:00:00.02"])


@pytest.mark.parametrize(
    "index",
    [
        Column(DATES.astype("M8[ns]")),
        Column(np.array([5000, 5010, 5020], "m8[ms]"), "since the start"),
        Column([0, 10, 20], "t[ms]"),
        Column([0.0, 0.01, 0.02], "time"),
    ],
)
def test_an_index_of_times_is_the_time(index):
    class Frame(dict):
        columns = property(list)

    Frame.index = index
    frame = columns_of_table(Frame({"gx": Column([1.0, 2.0, 3.0])}), None)
    one = columns_of_table(Column([1.0, 2.0, 3.0], "gy[mdps]", index=index), None)
    for table in (frame, one):
        assert table.time_s.tolist() == pytest.approx([0.0, 0.01, 0.02])
    assert dict(one.units) == {"gy": "mdps"}
    with_time = columns_of_table(Frame({"t": [1.0, 2.0, 3.0], "gx": [1.0, 2.0, 3.0]}), None)
    assert with_time.time_s.tolist() == [1.0, 2.0, 3.0]  # a column goes before the index


def test_row_numbers_are_no_time():
    one = columns_of_table(Column([1, 2], index=Column([0, 1])), None)
    assert one.time_s is None
    assert list(one.axes) == ["gx"]
    assert list(columns_of_table(Column([1, 2], "left"), ["ay"]).axes) == ["ay"]


def test_a_column_of_dates_is_the_time():
    table = columns_of_table({"time": DATES.astype("M8[us]"), "gx": [1, 2, 3]}, None)
    assert table.time_s.tolist() == pytest.approx([0.0, 0.01, 0.02])


def test_a_table_gives_the_result_of_its_arrays():
    noise = np.random.default_rng(4).normal(0.0, 0.05, 600)

    class Frame(dict):
        columns = property(list)

    results = (analyse(source, 100.0) for source in (Frame({"gx[dps]": noise}), noise))
    first, second = (one.axes["gx"].coefficients["N"].value for one in results)
    assert first == second
