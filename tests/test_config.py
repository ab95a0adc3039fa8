"""Settings: defaults, one clear line for what is wrong, and files that read back as they were written."""

import json
from pathlib import Path
from typing import Literal

import pytest
from pydantic import Field

from factorloc.config import Block, read_config, write_config
from factorloc.errors import ConfigError, FactorlocError


class Motor(Block):
    power: float = Field(2.0, gt=0)
    gears: int = Field(5, ge=1, le=9)


class Vehicle(Block):
    kind: Literal["cart", "car"] = "car"
    sizes: tuple[float, ...] = (1.0, 0.5)
    motor: Motor = Motor()


def refusal(call, *arguments, **values) -> str:
    with pytest.raises(ConfigError) as caught:
        call(*arguments, **values)
    line = str(caught.value)
    assert "\n" not in line
    return line


def test_what_is_not_said_has_its_default() -> None:
    vehicle = Vehicle(motor={"gears": 3})
    assert (vehicle.kind, vehicle.sizes, vehicle.motor) == ("car", (1.0, 0.5), Motor(power=2.0, gears=3))
    assert Vehicle() == Vehicle(motor=Motor())


def test_settings_cannot_be_changed_only_replaced() -> None:
    vehicle = Vehicle(sizes=(3.0,))
    with pytest.raises(ValueError, match="frozen"):
        vehicle.kind = "cart"
    other = vehicle.replaced(kind="cart")
    assert other == Vehicle(kind="cart", sizes=(3.0,))
    assert vehicle.kind == "car"


@pytest.mark.parametrize(
    ("values", "line"),
    [
        ({"gears": 10}, "Motor: gears: input should be less than or equal to 9, not 10"),
        ({"gears": 2.5}, "Motor: gears: input should be a valid integer, got a number with a fractional part, not 2.5"),
        ({"power": 0.0}, "Motor: power: input should be greater than 0, not 0.0"),
        ({"power": float("nan")}, "Motor: power: input should be a finite number, not nan"),
        ({"power": float("inf")}, "Motor: power: input should be a finite number, not inf"),
        ({"power": None}, "Motor: power: input should be a valid number, not None"),
        ({"torque": 1}, "Motor: torque: no such setting; remove it or correct its name"),
        ({"self": 1}, "Motor: self: no such setting; remove it or correct its name"),
        ({"power": -1, "gears": 0}, "Motor: power: input should be greater than 0, not -1 (and 1 more)"),
    ],
)
def test_a_wrong_setting_is_named_in_one_line(values: dict, line: str) -> None:
    assert refusal(Motor, **values) == line
    assert refusal(Motor().replaced, **values) == line


@pytest.mark.parametrize(
    ("values", "line"),
    [
        ({"motor": {"gears": 0}}, "Vehicle: motor.gears: input should be greater than or equal to 1, not 0"),
        ({"motor": {"tyres": 4}}, "Vehicle: motor.tyres: no such setting; remove it or correct its name"),
        ({"sizes": [1, None]}, "Vehicle: sizes.1: input should be a valid number, not None"),
        ({"kind": "ship"}, "Vehicle: kind: input should be 'cart' or 'car', not 'ship'"),
    ],
)
def test_a_wrong_setting_of_a_block_within_is_named_by_its_path(values: dict, line: str, tmp_path: Path) -> None:
    assert refusal(Vehicle, **values) == line
    path = tmp_path / "vehicle.json"
    path.write_text(json.dumps(values))
    assert refusal(read_config, path, Vehicle) == f"{path}: {line}"


def test_files_read_back_as_written(tmp_path: Path) -> None:
    vehicle = Vehicle(kind="cart", sizes=(0.1, 1e-9), motor=Motor(power=1 / 3, gears=1))
    write_config(tmp_path / "vehicle.json", vehicle)
    assert read_config(tmp_path / "vehicle.json", Vehicle) == vehicle
    written = json.loads((tmp_path / "vehicle.json").read_text())
    assert set(written) == {"kind", "sizes", "motor"}, "defaults are written out, too"


def test_toml_and_json_say_the_same(tmp_path: Path) -> None:
    (tmp_path / "a.toml").write_text('kind = "cart"\nsizes = [2, 1]\n[motor]\ngears = 4\n')
    (tmp_path / "a.json").write_text('{"kind": "cart", "sizes": [2, 1], "motor": {"gears": 4}}')
    expected = Vehicle(kind="cart", sizes=(2.0, 1.0), motor=Motor(gears=4))
    assert read_config(tmp_path / "a.toml", Vehicle) == read_config(tmp_path / "a.json", Vehicle) == expected
    (tmp_path / "empty.toml").touch()
    assert read_config(tmp_path / "empty.toml", Vehicle) == Vehicle()


@pytest.mark.parametrize(
    ("name", "content", "reason"),
    [
        ("a.toml", b"[motor\ngears = 4", "not toml"),
        ("a.toml", b"\xff\xfe\x00", "not toml"),
        ("a.json", b'{"kind": ', "not json"),
        ("a.json", b"", "not json"),
        ("a.json", b"[1, 2]", "expected a table of settings"),
        ("settings", b"gears 4", "not TOML"),
    ],
)
def test_a_garbled_file_is_refused_by_name(tmp_path: Path, name: str, content: bytes, reason: str) -> None:
    path = tmp_path / name
    path.write_bytes(content)
    assert refusal(read_config, path, Vehicle).startswith(f"{path}: {reason}")


def test_a_missing_file_and_a_folder_are_refused_by_name(tmp_path: Path) -> None:
    missing = tmp_path / "no.toml"
    assert refusal(read_config, missing, Vehicle) == f"{missing}: cannot be read (No such file or directory)"
    assert refusal(read_config, tmp_path, Vehicle) == f"{tmp_path}: cannot be read (Is a directory)"


def test_settings_that_cannot_be_written_say_so(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(FactorlocError, match="cannot be written"):
        write_config(tmp_path / "file" / "a.json", Vehicle())


def test_the_settings_of_the_localizer_round_trip(tmp_path: Path) -> None:
    from factorloc.localization import LocalizationSettings

    settings = LocalizationSettings(
        information=0.3, blurs=(0.5, 0.0), odometry={"huber": 2.0}, tracking={"start_grid": 2}
    )
    write_config(tmp_path / "settings.json", settings)
    assert read_config(tmp_path / "settings.json", LocalizationSettings) == settings
    line = refusal(LocalizationSettings, optimizer={"lever_arm": 0})
    assert line == "LocalizationSettings: optimizer.lever_arm: input should be greater than 0, not 0"
