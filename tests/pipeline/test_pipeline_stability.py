"""Single quantities of the theory from the command line, against values of others."""

import csv
import io
import json

import allantools
import numpy as np
import pytest

from allanscope.__main__ import main
from allanscope.noise import model_of
from allanscope.simulator.noise import FlickerPhase, White

RNG = np.random.default_rng(31)


def nbs14():
    """Return the 1000 points of NIST SP 1065, section 12.4."""
    n, values = 1234567890, []
    for _ in range(1000):
        values.append(n / 2147483647)
        n = 16807 * n % 2147483647
    return np.array(values)


@pytest.fixture
def ask(capsys, tmp_path):
    """Return a function that asks the command and returns its columns."""

    def run(name, *inputs, head="", **options):
        paths = []
        for i, values in enumerate(inputs):
            path = tmp_path / f"{i}.txt"
            path.write_text(head + "\n".join(map(repr, np.asarray(values).tolist())))
            paths.append(str(path))
        words = [w for k, v in options.items() for w in (f"--{k.replace('_', '-')}", str(v))]
        assert main(["stability", name, *paths, *words]) == 0
        rows = list(csv.DictReader(io.StringIO(capsys.readouterr().out)))
        return {key: [row[key] for row in rows] for key in rows[0]}

    return run


def numbers(column):
    return [float(value) for value in column]


def test_noise_and_deviation_of_published_data(ask):
    """OADEV, MDEV and TOTDEV that SP 1065 publishes of its 1000 points, to 1e-6."""
    published = {
        "oadev": [2.922319e-1, 9.159953e-2, 3.241343e-2],
        "mdev": [2.922319e-1, 6.172376e-2, 2.170921e-2],
        "totdev": [2.922319e-1, 9.134743e-2, 3.406530e-2],
    }
    for kind, values in published.items():
        heading = "File: nbs14\nDate: -\n"
        found = ask("identify", nbs14(), head=heading, kind=kind, taus="1,10,100")
        assert numbers(found["deviation"]) == pytest.approx(values, rel=1e-6)
        assert found["noise"] == ["WFM"] * 3


def test_time_errors_are_those_of_allantools(ask):
    rates = RNG.normal(size=700)
    phase = np.append(0.0, rates.cumsum())
    for name, theirs in (("mtie", allantools.mtie), ("tierms", allantools.tierms)):
        found = ask(name, rates, taus="1,4,100")
        _, expected, _, _ = theirs(phase, rate=1.0, taus=[1, 4, 100])
        assert numbers(found[name]) == pytest.approx(expected, rel=1e-8)
        of_phase = ask(name, phase, taus="1,4,100", data="phase")
        assert numbers(of_phase[name]) == pytest.approx(expected, rel=1e-8)


def test_what_two_records_share_is_that_of_allantools(ask):
    a, b, c = RNG.normal(size=(3, 3000)) * [[3.0], [1.0], [1.0]]
    found = ask("gcodev", a - b, a - c, taus="1,4,32")
    phases = [np.append(0.0, np.cumsum(x)) for x in (a - b, a - c)]
    _, expected, _, _ = allantools.gcodev(*phases, rate=1.0, taus=[1, 4, 32])
    assert np.abs(numbers(found["gcodev"])) == pytest.approx(expected, rel=1e-8)


def test_a_hat_of_three_corners_is_that_of_allantools(ask):
    a, b, c = RNG.normal(size=(3, 3000)) * [[1.0], [2.0], [3.0]]
    pairs = a - b, b - c, c - a
    phases = [np.append(0.0, np.cumsum(x)) for x in pairs]
    _, expected, _, _ = allantools.three_cornered_hat_phase(
        *phases, rate=1.0, taus=[1, 8], function=allantools.oadev
    )
    found = ask("hat", *pairs, taus="1,8")
    assert numbers(found["a"]) == pytest.approx(expected, rel=1e-6)
    assert numbers(found["b"]) == pytest.approx([2.0, 2.0 / 8**0.5], rel=0.1)


@pytest.mark.parametrize(("noise", "alpha"), [("WPM", 2), ("FFM", -1), ("RWFM", -2)])
def test_degrees_of_freedom_are_those_of_greenhall_and_riley(ask, noise, alpha):
    """4 %: their phase is averaged over one sample."""
    found = ask("edf", kind="oadev", noise_type=noise, samples=1000, taus="20")
    expected = allantools.edf_greenhall(alpha, 2, 20, 1001, overlapping=True, modified=False)
    assert numbers(found["edf"]) == pytest.approx([expected], rel=0.04)
    theirs = allantools.confidence_interval(1.0, float(found["edf"][0]), ci=0.95)
    assert [float(found[k][0]) for k in ("lower", "upper")] == pytest.approx(theirs, rel=1e-6)


def test_degrees_of_freedom_of_the_total_deviation_are_published(ask):
    """SP 1065 table 7 for flicker FM: 1.17 T/tau - 0.22."""
    found = ask("edf", kind="totdev", noise_type="FFM", samples=10_000, taus="500", rate=1)
    assert numbers(found["edf"]) == pytest.approx([1.17 * 20 - 0.22], rel=0.01)


def test_the_covariance_of_variances_is_that_of_many_records(ask):
    """4000 records of white noise and random walk: variances to 5 %, correlations to 0.05."""
    found = ask("cov", model="N=1,K=0.1", samples=256, taus="2,8", rate=1)
    theory = np.array([numbers(found["m2"]), numbers(found["m8"])])
    rng = np.random.default_rng(7)
    walks = rng.normal(size=(4000, 256)) + 0.1 * rng.normal(size=(4000, 256)).cumsum(axis=1)
    x = np.concatenate([np.zeros((4000, 1)), walks.cumsum(axis=1)], axis=1)
    measured = np.array(
        [
            np.mean((x[:, 2 * m :] - 2 * x[:, m:-m] + x[:, : -2 * m]) ** 2, axis=1) / (2 * m**2)
            for m in (2, 8)
        ]
    )
    assert numbers(found["variance"]) == pytest.approx(measured.mean(axis=1), rel=0.02)
    sampled = np.cov(measured)
    assert np.diag(theory) == pytest.approx(np.diag(sampled), rel=0.1)
    correlation = [c[0, 1] / np.sqrt(c[0, 0] * c[1, 1]) for c in (theory, sampled)]
    assert correlation[0] == pytest.approx(correlation[1], abs=0.05)


def test_the_covariance_of_every_power_law_is_there(ask):
    """Of flicker PM by AVAR, of flicker walk and random run by HVAR: 11/120 D^2 tau^3."""
    flicker = ask("cov", model="P=1", samples=4096, taus="1,64", rate=1)
    assert numbers(flicker["variance"])[0] == pytest.approx(1.697653, rel=1e-6)
    run = ask("cov", model="D=1", kind="ohdev", samples=4096, taus="256", rate=1)
    assert numbers(run["variance"]) == pytest.approx([11 / 120 * 256**3], rel=1e-3)
    walk = ask("cov", model="F=1", kind="ohdev", samples=4096, taus="256", rate=1)
    variance, covariance = (numbers(walk[name])[0] for name in ("variance", "m256"))
    edf = allantools.edf_greenhall(-3, 3, 256, 4097, overlapping=True, modified=False)
    assert 2 * variance**2 / covariance == pytest.approx(edf, rel=0.06)


def test_power_laws_are_fitted_with_intervals(ask):
    rng = np.random.default_rng(11)
    record = White(0.01, 10.0, rng).take(12_000) + FlickerPhase(0.01, 10.0, rng).take(12_000)
    found = ask("fit", record, rate=10, letters="auto")
    assert found["coefficient"][:2] == ["P", "N"]  # both were identified
    for i in (0, 1):
        assert float(found["lower"][i]) < 0.01 < float(found["upper"][i])
        assert found["detected"][i] == "1"


def test_one_line_is_read_off_a_curve(ask):
    found = ask("avlr", 0.3 * RNG.normal(size=20_000), letters="N", low=1, high=64)
    assert float(found["lower"][0]) < 0.3 < float(found["upper"][0])


def test_a_recording_is_read_by_axis(tmp_path, capsys):
    out = tmp_path / "short.mcap"
    noise = ["--noise", "N=0.01,axis=gx", "--noise", "N=0.02,axis=gy"]
    main(["simulate", str(out), "--hours", "0.02", "--rate", "104", "--quiet", *noise])
    for axis, level in (("gx", 0.01), ("gy", 0.02)):
        assert main(["stability", "avlr", str(out), "--axis", axis, "--high", "1"]) == 0
        value = float(capsys.readouterr().out.splitlines()[1].split(",")[1])
        assert value == pytest.approx(level, rel=0.1)
    table = tmp_path / "mtie.csv"
    assert main(["stability", "mtie", str(out), "--out", str(table)]) == 0
    assert table.read_text().startswith("tau_s,m,mtie\n")


def test_times_are_those_of_the_measured_rate(tmp_path, capsys):
    """The simulated part is 1.4 % slow."""
    path, out = str(tmp_path / "a.mcap"), tmp_path / "a.json"
    assert main(["simulate", path, "--hours", "0.02", "--rate", "104", "--quiet"]) == 0
    assert main(["analyse", path, "--json", str(out), "--quiet"]) == 0
    measured = json.loads(out.read_text())["rate"]["measured_hz"]
    assert abs(measured / 104.0 - 1) > 0.01
    words = ["stability", "identify", path, "--axis", "gx", "--taus", "0.1,1", "--quiet"]
    assert main(words) == 0
    first, _ = csv.DictReader(io.StringIO(capsys.readouterr().out))
    assert float(first["m"]) / float(first["tau_s"]) == pytest.approx(measured, rel=1e-8)


def test_gaps_leave_the_longest_stretch(ask, capsys):
    values = RNG.normal(size=400)
    values[100] = np.nan
    found = ask("identify", values, taus="1")
    assert numbers(found["deviation"]) == pytest.approx([1.0], rel=0.1)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["gcodev", "a.txt"], "gcodev takes 2 inputs, 1 given"),
        (["edf"], "edf needs --samples"),
        (["cov", "--samples", "100", "--model", "X=1"], "write e.g. N=0.003,B=0.001"),
        (["cov", "--samples", "100", "--model", "F=1"], "has no expectation; take ohdev"),
        (["edf", "--samples", "100", "--kind", "xdev"], "unknown estimator 'xdev'"),
        (["edf", "--samples", "100", "--taus", "90"], "needs 81 samples"),
        (["fit", "a.txt", "--letters", "PF"], "cannot be fitted beside"),
    ],
)
def test_what_cannot_be_computed_is_an_error_of_one_line(words, message, tmp_path, capsys):
    (tmp_path / "a.txt").write_text("\n".join(map(str, range(100))))
    given = [str(tmp_path / w) if w.endswith(".txt") else w for w in words]
    assert main(["stability", *given]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert message in line


def test_a_model_is_read_from_words():
    model = model_of("N=2,K=1", 0.1)
    assert model.deviation("oadev", [10]) ** 2 == pytest.approx([4 + (1 + 0.005) / 3], rel=1e-9)
