"""The list of all settings: complete, and shown by the command and on the site."""

import importlib
import re
from collections.abc import Container, Iterator
from typing import Literal

import pytest
from msgspec.inspect import StructType, type_info
from typer.testing import CliRunner

from common.config import Config
from common.field_comments import field_comments
from common.io.files import parse_toml
from deploy.cli import app
from deploy.settings import ABSENT, BY_PROCESSOR, REQUIRED, TABLE, all_settings
from scripts.site import settings_page
from tests import ROOT

PACKAGES = ("common", "services", "lab", "evaluation", "deploy")
UNIT = re.compile(r"(\[[^]]*\])?")  # no meaning, or only a unit


class Base(Config, frozen=True, kw_only=True):
    low: float = 0.5  # [m] of the base


class Derived(Base, frozen=True, kw_only=True):
    high: float = 2.0
    # first line
    # and second line
    mode: Literal["on", "off"] = "on"
    low: float = 1.0  # [m] of the derived record


def configs(record: type[Config], modules: Container[str]) -> Iterator[type[Config]]:
    below = [r for r in record.__subclasses__() if r.__module__ in modules]
    for one in below:
        yield from configs(one, modules)
    if not below:
        yield record


def test_every_field_of_every_configuration_record_is_listed() -> None:
    files = [file for package in PACKAGES for file in (ROOT / package).rglob("*.py")]
    # Other modules are of tests, which also define services, plug-ins and their records.
    modules = {
        ".".join(file.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__"): file
        for file in files
    }
    for module, file in modules.items():
        if re.search(r"^class \w+\(\w*(Config|Settings|Options)\b", file.read_text("utf-8"), re.M):
            importlib.import_module(module)
    listed = {
        (s.record, s.name.rpartition(".")[2]) for rows in all_settings().values() for s in rows
    }
    found = map(type_info, configs(Config, modules))
    records = [record for record in found if isinstance(record, StructType)]
    assert len(records) > 40
    values = {
        (record.cls, field.name)
        for record in records
        for field in record.fields
        if "StructType" not in repr(field.type)
    }
    assert not values - listed


def test_every_setting_has_a_meaning_on_the_page() -> None:
    page = settings_page()
    for rows in all_settings().values():
        for row in rows:
            assert not UNIT.fullmatch(row.meaning), row
            assert "None:" not in row.meaning, row
            assert f"| `{row.name}` | `{row.default}` | " in page


def test_page_escapes_markup_outside_of_code() -> None:
    page = settings_page()
    assert r"\[s\] duration, at least twice `move_s` |" in page
    assert r"mount\_\* is the pose of the upright camera" in page


def test_comment_is_at_the_end_of_the_field_or_above_it() -> None:
    assert field_comments(Derived) == {
        "low": "[m] of the derived record",
        "high": "",
        "mode": "first line and second line",
    }


def test_default_is_of_the_enclosing_record() -> None:
    names = {s.name: s.default for rows in all_settings().values() for s in rows}
    assert names["ros2_bridge.outputs.markers.rate_max_hz"] == "15.0"
    assert names["ros2_bridge.outputs.people.rate_max_hz"] == "0.0"
    assert names["gt_bridge.transforms[].parent"] == "required"
    assert names["camera.max_depth_m"] == "absent"


def test_default_is_a_value_of_toml_or_a_known_word() -> None:
    defaults = {s.name: s.default for rows in all_settings().values() for s in rows}
    for name, default in defaults.items():
        if default not in (REQUIRED, ABSENT, TABLE, BY_PROCESSOR):
            parse_toml(f"{name.rpartition('.')[2]} = {default}")
    assert defaults["tracker.tracker"] == '"strongsort3d"'
    assert defaults["camera.source"] == '""'
    assert defaults["camera.loop"] == "false"
    assert defaults["ros2_bridge.publish"] == '["people", "markers"]'


def test_default_that_depends_on_the_processor_is_not_the_one_of_this_processor() -> None:
    defaults = {s.name: s.default for s in all_settings()["detector"]}
    assert defaults["detector.model"] == "by the processor"
    assert defaults["detector.orientation.network"] == "by the processor"


def test_table_with_a_comment_is_listed_before_its_settings() -> None:
    rows = [s[:3] for s in all_settings()["tracker"]]
    at = [name for name, *_ in rows].index("tracker.strongsort3d.identity")
    assert rows[at][1:] == ("table", "re-identify returning people; section 15")
    assert rows[at + 1][0] == "tracker.strongsort3d.identity.enabled"
    lists = {s.name: s.default for s in all_settings()["gt_bridge"]}
    assert lists["gt_bridge.transforms"] == "[]"


@pytest.mark.parametrize("name", ["tracker.sort3d", "tracker.sort3d.t_lost"])
def test_command_shows_the_settings_that_begin_with_a_name(name: str) -> None:
    result = CliRunner().invoke(app, ["settings", name])
    names = [line.split()[0] for line in result.stdout.splitlines()[2:]]  # after title and header
    assert "tracker.sort3d.t_lost" in names
    assert all(n.startswith(name) for n in names)


def test_unknown_name_is_an_error_with_a_choice() -> None:
    result = CliRunner().invoke(app, ["settings", "trakcer"])
    assert result.exit_code == 1
    assert "no setting begins with 'trakcer'. Choose camera," in result.stderr
