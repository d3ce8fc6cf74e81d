"""A damaged digit of a table: counted, said, and in no sum."""

from __future__ import annotations

import json

import numpy as np

from allanscope.__main__ import main


def test_a_damaged_digit_is_counted_said_and_in_no_sum(tmp_path, capsys):
    rows = np.random.default_rng(4).normal(0.0, 0.04, (1500, 3))
    lines = ["gx[dps],gy[dps],gz[dps]", *(",".join(f"{v:.4f}" for v in row) for row in rows)]
    lines[500] = "0.01,0.0p2,0.03"
    wanted = lines.copy()
    gx, _, gz = lines[1000].split(",")
    lines[1000] = f"{gx},8.0123,{gz}"
    wanted[1000] = "0.01,0.0p2,0.03"
    results = []
    for name, text in (("damaged", lines), ("wanted", wanted)):
        path = tmp_path / f"{name}.csv"
        path.write_text("\n".join(text) + "\n")
        result = tmp_path / f"{name}.json"
        assert main(["analyse", str(path), "--rate", "104", "--json", str(result)]) == 0
        results.append(json.loads(result.read_text()))
        assert ("Suspect rows" in capsys.readouterr().out) == (name == "damaged")
    damaged, wanted = results
    assert (damaged["link"]["suspect"], wanted["link"]["suspect"]) == (1, 0)
    assert damaged["samples"] == wanted["samples"] == 1498
    assert damaged["axes"]["gy"]["curves"] == wanted["axes"]["gy"]["curves"]
