"""``python -m benchmarks [--quick] [--data DIR]``: all benchmarks, one after the other."""

from __future__ import annotations

import sys

from benchmarks import carmen, raycast, solver


def main() -> int:
    """Run all; the exit code is 1 if any goal was missed. Without real data those that need it are left out."""
    common = sys.argv[1:]
    codes = {
        "raycast": raycast.main(common),
        "solver": solver.main(common),
        **{
            f"carmen {name}": carmen.main(
                [*common, "--log", name, "--json", f"out/carmen-{name}.json", "--plot", f"out/carmen-{name}.png"]
            )
            for name in ("intel", "aces")
        },
    }
    words = {0: "goals met", 1: "a goal was missed", 2: "left out: no real data"}
    for name, code in codes.items():
        print(f"{name}: {words[code]}")
    return int(1 in codes.values())


if __name__ == "__main__":
    sys.exit(main())
