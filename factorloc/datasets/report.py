"""What a reader made of a file or a folder: lines or frames used, damaged, passed over."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

__all__ = ["Damage", "ReadReport", "Tally"]


@dataclass(frozen=True)
class Damage:
    """Lines left out for one reason.

    Parameters
    ----------
    reason : str
        What is wrong with them.
    count : int
        How many there are.
    first_line : int
        Number of the first one: lines count from 1, frames bear numbers of their own.
    unit : str
        What is counted: ``line``, or ``frame`` where a folder holds a file each.
    """

    reason: str
    count: int
    first_line: int
    unit: str = "line"

    def __str__(self) -> str:
        return f"{self.count} x {self.reason} (first at {self.unit} {self.first_line})"


@dataclass(frozen=True)
class ReadReport:
    """Account of one file, in which every line appears once; or of one folder and its frames.

    Parameters
    ----------
    path : Path
        The file or folder.
    lines : int
        Lines read, blank ones and comments included; or frames found.
    used : mapping of str to int
        Message kinds that were understood, and how often they occur.
    ignored : mapping of str to int
        Message kinds that were passed over.
    damaged : tuple of Damage
        Lines left out, by reason.
    notes : tuple of str
        Assumptions made where the file is silent, and what was counted besides.
    unit : str
        What is counted: ``line`` or ``frame``.
    """

    path: Path
    lines: int
    used: Mapping[str, int] = field(default_factory=dict)
    ignored: Mapping[str, int] = field(default_factory=dict)
    damaged: tuple[Damage, ...] = ()
    notes: tuple[str, ...] = ()
    unit: str = "line"

    @property
    def damaged_lines(self) -> int:
        """How many lines (or frames) were left out as damaged."""
        return sum(damage.count for damage in self.damaged)

    def damage(self) -> str:
        """The damage in words, for one line of a message."""
        reasons = "; ".join(str(damage) for damage in self.damaged)
        return (
            f"{self.damaged_lines} damaged {self.unit}s left out: {reasons}" if reasons else f"no damaged {self.unit}s"
        )

    def __str__(self) -> str:
        used = ", ".join(f"{count} {kind}" for kind, count in self.used.items()) or "nothing"
        ignored = ", ".join(f"{count} {kind}" for kind, count in self.ignored.items())
        parts = [f"{self.path}: {self.lines} {self.unit}s, used {used}", self.damage()]
        parts += [f"passed over {ignored}"] if ignored else []
        return "; ".join([*parts, *self.notes])


class Tally:
    """Count the lines of a file, or the frames of a folder, while it is read."""

    def __init__(self, unit: str = "line") -> None:
        self.lines = 0
        self._unit = unit
        self._used: Counter[str] = Counter()
        self._ignored: Counter[str] = Counter()
        self._damaged: Counter[str] = Counter()
        self._first: dict[str, int] = {}

    def use(self, kind: str) -> None:
        """Count a line that was understood."""
        self._used[kind] += 1

    def ignore(self, kind: str) -> None:
        """Count a line that was passed over."""
        self._ignored[kind] += 1

    def damage(self, reason: str, line: int) -> None:
        """Count a damaged line, by its reason."""
        self._damaged[reason] += 1
        self._first.setdefault(reason, line)

    def report(self, path: Path, notes: tuple[str, ...] = ()) -> ReadReport:
        """Close the account."""
        damaged = tuple(
            Damage(reason, count, self._first[reason], self._unit) for reason, count in self._damaged.items()
        )
        return ReadReport(path, self.lines, dict(self._used), dict(self._ignored), damaged, notes, self._unit)
