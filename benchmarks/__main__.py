"""Run the benchmarks and put their figures in one table.

    python -m benchmarks [NAME ...] [--quick] [--out FOLDER] [--list]
    python -m benchmarks NAME [its own options]

Every script of this folder that has a ``main`` is a benchmark, by its file name. Each runs in a
process of its own; its JSON is kept in the folder, and ``all.json`` holds every figure. What a
script says about itself is in its first line: see `benchmarks/figures.py` for what it must do.
One benchmark alone shows what it prints; given options of its own it runs outside of this.
"""

from __future__ import annotations

import argparse
import ast
import json
import subprocess
import sys
import time
from pathlib import Path

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE))

from figures import Figure, busy, machine, table  # noqa: E402

TOOLS = {"long_recording"}
"""Scripts that make something for others."""


def benchmarks() -> dict[str, str]:
    """Return the name of every benchmark and its first line."""
    found = {}
    for path in sorted(HERE.glob("[!_]*.py")):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        has_main = any(isinstance(n, ast.FunctionDef) and n.name == "main" for n in tree.body)
        if has_main and path.stem not in TOOLS:
            found[path.stem] = (ast.get_docstring(tree) or "").partition("\n")[0]
    return found


def run(name: str, quick: bool, out: Path, shown: bool) -> tuple[list[Figure], str]:
    """Run one benchmark; return its figures, and what went wrong."""
    result = out / f"{name}.json"
    result.unlink(missing_ok=True)
    options = ["--quick"] if quick and _understands(name, "--quick") else []
    if _understands(name, "--json"):
        options += ["--json", str(result)]
    command = [sys.executable, str(HERE / f"{name}.py"), *options]
    code = logged(command, out / f"{name}.txt", shown)
    if code:
        return [], f"ended with code {code}: see {out / name}.txt"
    if not result.is_file():
        return [], f"has no JSON: see {out / name}.txt"
    content = json.loads(result.read_text(encoding="utf-8"))
    rows = content.get("figures", []) if isinstance(content, dict) else []
    return [Figure(**row) for row in rows], "" if rows else f"no figures: see {out / name}.txt"


def logged(command: list[str], path: Path, shown: bool) -> int:
    """Run a command, keep what it prints and perhaps show it, too; return its exit code."""
    with (
        path.open("w", encoding="utf-8") as log,
        subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, encoding="utf-8"
        ) as process,
    ):
        for line in process.stdout or ():
            log.write(line)
            if shown:
                print(line, end="", flush=True)
    return process.returncode


def alone(name: str, options: list[str]) -> int:
    """Run one benchmark with options of its own; return its exit code."""
    return subprocess.run([sys.executable, HERE / f"{name}.py", *options], check=False).returncode


def _understands(name: str, option: str) -> bool:
    return f'"{option}"' in (HERE / f"{name}.py").read_text(encoding="utf-8")


def main() -> int:
    """Run what was asked for; 1 when a benchmark fails."""
    known = benchmarks()
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description="Run the benchmarks.")
    parser.add_argument("names", nargs="*", metavar="NAME", help="which ones; all by default")
    parser.add_argument("--quick", action="store_true", help="small sizes: minutes, not hours")
    parser.add_argument("--out", type=Path, default=Path("benchmark-results"), metavar="FOLDER")
    parser.add_argument("--list", action="store_true", help="say which ones there are")
    options, own = parser.parse_known_args()
    if options.list:
        print("\n".join(f"{name:20} {about}" for name, about in known.items()))
        return 0
    for name in options.names:
        if name not in known:
            parser.error(f"no benchmark {name!r}; there are {' '.join(known)}")
    single = len(options.names) == 1
    if own and not single:
        parser.error(f"{own[0]} is no option of all benchmarks; name the one that it is for")
    if own:
        return alone(options.names[0], [*own, *["--quick"] * options.quick])
    options.out.mkdir(parents=True, exist_ok=True)
    rows: list[tuple[str, Figure]] = []
    failed = 0
    for name in options.names or known:
        began = time.monotonic()
        figures, trouble = run(name, options.quick, options.out, single)
        failed += trouble.startswith("ended")
        rows += [(name, figure) for figure in figures]
        print(f"{name}: {trouble or 'done'} ({time.monotonic() - began:.0f} s)", file=sys.stderr)
    print(table(rows))
    print(busy())
    flat = [{"benchmark": name, **vars(figure), "ratio": figure.ratio} for name, figure in rows]
    whole = {"machine": machine(), "quick": options.quick, "figures": flat}
    (options.out / "all.json").write_text(json.dumps(whole, indent=1) + "\n", encoding="utf-8")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
