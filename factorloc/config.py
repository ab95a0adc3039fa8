"""Settings: blocks with defaults, read from TOML or JSON, written resolved beside every result."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path
from typing import Any, Self, TypeVar

from pydantic import BaseModel, ConfigDict, ValidationError

from factorloc.errors import ConfigError
from factorloc.files import write_text

__all__ = ["Block", "read_config", "write_config"]

_B = TypeVar("_B", bound="Block")


class Block(BaseModel):
    """A frozen group of settings; unknown names and values out of range are refused with one clear line.

    Raises
    ------
    ConfigError
        If a setting is unknown, of the wrong type or out of its range.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    def __init__(self, /, **values: Any) -> None:
        try:
            super().__init__(**values)
        except ValidationError as error:
            raise ConfigError(f"{type(self).__name__}: {_first_problem(error)}") from error

    def replaced(self, /, **values: Any) -> Self:
        """Return a copy with some settings changed, checked like any other."""
        return type(self)(**{**{name: getattr(self, name) for name in type(self).model_fields}, **values})


def _first_problem(error: ValidationError) -> str:
    problems = error.errors()
    first = problems[0]
    where = ".".join(str(part) for part in first["loc"]) or "settings"
    cause = first.get("ctx", {}).get("error")
    if isinstance(cause, ConfigError):  # a block within: its own line, below the path that leads to it
        text = f"{where}.{str(cause).partition(': ')[2]}"
    elif first["type"] == "value_error":  # a validator's own line
        text = f"{where}: {cause}"
    elif first["type"] == "extra_forbidden":
        text = f"{where}: no such setting; remove it or correct its name"
    else:
        text = f"{where}: {first['msg'][0].lower()}{first['msg'][1:]}, not {first['input']!r}"
    return text if len(problems) == 1 else f"{text} (and {len(problems) - 1} more)"


def read_config(path: Path | str, block: type[_B]) -> _B:
    """Read settings; what a file leaves out has its default.

    Parameters
    ----------
    path : Path or str
        TOML or JSON file, by its ending.
    block : type of Block
        What it holds.

    Raises
    ------
    ConfigError
        If the file is missing, cannot be parsed, or a setting is wrong.
    """
    path = Path(path)
    try:
        text = path.read_text(encoding="utf-8")
        values = json.loads(text) if path.suffix == ".json" else tomllib.loads(text)
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read ({error.strerror})") from error
    except (ValueError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path}: not {path.suffix.lstrip('.') or 'TOML'} ({error})") from error
    if not isinstance(values, dict):
        raise ConfigError(f"{path}: expected a table of settings")
    try:
        return block(**values)
    except ConfigError as error:
        raise ConfigError(f"{path}: {error}") from error


def write_config(path: Path | str, block: Block) -> None:
    """Write all settings, defaults included, as JSON."""
    write_text(path, block.model_dump_json(indent=2) + "\n")
