"""Against codac, which changes the rounding of its process: it answers from a process of its own, where installed."""

import json
import subprocess
import sys
from typing import Any

import numpy as np
import pytest

from factorloc.intervals import Box, Fixpoint, Interval, Polar, atan2, cos, sin, sqrt, square

ANSWER = """
import json, sys
import codac
given = json.load(sys.stdin)
names = {
    "add": lambda x, y: x + y, "subtract": lambda x, y: x - y, "multiply": lambda x, y: x * y,
    "divide": lambda x, y: x / y, "square": lambda x, y: codac.sqr(x), "sqrt": lambda x, y: codac.sqrt(x),
    "cos": lambda x, y: codac.cos(x), "sin": lambda x, y: codac.sin(x), "atan2": lambda y, x: codac.atan2(y, x),
}
answers = {name: [] for name in names}
def bounds(x):
    return None if x.is_empty() else [x.lb().hex(), x.ub().hex()]
def interval(bounds):
    return codac.Interval(*(float.fromhex(bound) for bound in bounds))
for a, b, c, d in given["pairs"]:
    for name, run in names.items():
        answers[name].append(bounds(run(interval([a, b]), interval([c, d]))))
answers["polar"] = []
for sides in given["polar"]:
    box = [interval(side) for side in sides]
    x, y, r, t = box
    for _ in range(5):  # once does not always leave the smallest box
        codac.CtcPolar().contract(x, y, r, t)
    gone = any(side.is_empty() for side in (x, y, r, t))
    answers["polar"].append(None if gone else [bounds(side) for side in (x, y, r, t)])
json.dump(answers, sys.stdout)
"""

OURS = {
    "add": lambda x, y: x + y, "subtract": lambda x, y: x - y, "multiply": lambda x, y: x * y,
    "divide": lambda x, y: x / y, "square": lambda x, y: square(x), "sqrt": lambda x, y: sqrt(x),
    "cos": lambda x, y: cos(x), "sin": lambda x, y: sin(x), "atan2": atan2,
}  # fmt: skip

CORRECTLY_ROUNDED = ("add", "subtract", "multiply", "divide", "square", "sqrt")


@pytest.fixture(scope="module")
def pairs() -> np.ndarray:
    rng = np.random.default_rng(11)
    ends = rng.uniform(-10, 10, (2000, 4))
    ends[::5, 2:] = np.abs(ends[::5, 2:])
    ends[::7] = np.round(ends[::7])
    ends = np.concatenate([np.sort(ends[:, :2]), np.sort(ends[:, 2:])], 1)
    ends[::11, 1] = ends[::11, 0] + 1e-9
    return ends


@pytest.fixture(scope="module")
def polar_boxes() -> np.ndarray:
    rng = np.random.default_rng(12)
    r, b = rng.uniform(0.5, 20, 1000), rng.uniform(-3, 3, 1000)
    solution = np.stack([r * np.cos(b), r * np.sin(b), r, b], 1)
    wide = 10.0 ** rng.uniform(-3, 1, (2, 1000, 4))
    boxes = np.stack([solution - wide[0], solution + wide[1]], 2)
    boxes[:, 2, 0] = np.maximum(boxes[:, 2, 0], 0.1)
    boxes[:, 3] = np.clip(boxes[:, 3], -3.1, 3.1)
    return boxes


def in_hex(values: Any) -> Any:
    return [in_hex(value) for value in values] if isinstance(values, list) else values.hex()


def from_hex(answer: Any) -> Any:
    if isinstance(answer, list):
        return [from_hex(value) for value in answer]
    return None if answer is None else float.fromhex(answer)


@pytest.fixture(scope="module")
def answers(pairs, polar_boxes) -> dict[str, Any]:
    there = subprocess.run([sys.executable, "-c", "import codac"], capture_output=True, text=True, timeout=60)
    if there.returncode:
        pytest.skip("codac is not installed: pip install codac to compare with it (LGPL; a test oracle only)")
    # Decimal numbers would be read and written with the rounding that codac leaves; hexadecimal ones are exact.
    given = json.dumps({"pairs": in_hex(pairs.tolist()), "polar": in_hex(polar_boxes.tolist())})
    done = subprocess.run([sys.executable, "-c", ANSWER], input=given, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    assert "codac" not in sys.modules
    return {name: [from_hex(answer) for answer in every] for name, every in json.loads(done.stdout).items()}


@pytest.mark.parametrize("name", OURS)
def test_operations_agree(name, pairs, answers) -> None:
    own = OURS[name](Interval(pairs[:, 0], pairs[:, 1]), Interval(pairs[:, 2], pairs[:, 3]))
    theirs = np.array([[np.nan, np.nan] if answer is None else answer for answer in answers[name]], float)
    assert (own.is_empty == np.isnan(theirs[:, 0])).all()
    there = ~own.is_empty
    if name in CORRECTLY_ROUNDED:
        assert (own.lo[there] <= theirs[there, 0]).all()
        assert (own.hi[there] >= theirs[there, 1]).all()
    finite = there & np.isfinite(theirs).all(1)
    assert np.array_equal(np.isfinite(own.lo), np.isfinite(theirs[:, 0]))
    if name == "atan2":  # of the zero vector, and across the negative axis, conventions differ
        finite &= (pairs[:, 2] > 0) | (pairs[:, 0] > 0) | (pairs[:, 1] < 0)
    assert np.allclose(own.lo[finite], theirs[finite, 0], rtol=1e-14, atol=1e-14)
    assert np.allclose(own.hi[finite], theirs[finite, 1], rtol=1e-14, atol=1e-14)


def test_polar_contractions_agree(polar_boxes, answers) -> None:
    """On a few boxes codac stops short of the smallest, or this package does: neither may lose a solution."""
    box = Box(Interval(polar_boxes[:, :, 0].T, polar_boxes[:, :, 1].T))
    own = Fixpoint(Polar()).contract(box)
    empty = [[np.nan, np.nan]] * 4
    theirs = np.array([empty if answer is None else answer for answer in answers["polar"]], float)
    assert np.array_equal(own.is_empty, np.isnan(theirs[:, 0, 0]))
    kept = ~own.is_empty
    change = np.concatenate([own.lo.T[kept] - theirs[kept, :, 0], theirs[kept, :, 1] - own.hi.T[kept]], 1)
    assert (np.abs(change) < 1e-9).mean() > 0.95
    rng = np.random.default_rng(13)
    for n in np.flatnonzero((change > 1e-9).any(1)):  # where ours is smaller
        lo, hi = box.lo[:, kept][:, n], box.hi[:, kept][:, n]
        r, b = rng.uniform(lo[2], hi[2], 300_000), rng.uniform(lo[3], hi[3], 300_000)
        points = np.stack([r * np.cos(b), r * np.sin(b), r, b])
        points = points[:, ((lo[:, None] <= points) & (points <= hi[:, None])).all(0)]
        assert ((own.lo[:, kept][:, n, None] <= points) & (points <= own.hi[:, kept][:, n, None])).all()
