"""Options of an export are declared once: the command line, the window and the formats agree, and a form is kept as JSON."""

import argparse
import json
from dataclasses import fields
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from runtime.errors import UsageError
from runtime.formats.options import ALL, ExportOptions, ExportSpec
from runtime.formats.table import FORMATS, ExportCancelled, save_motion
from runtime.options import spec_of
from runtime.safe_read import parse_json
from runtime.takes.clip import Clip
from runtime.terrain.height_map import Terrain
from sport.commands.arguments import add_export_arguments
from sport.commands.export import export_options
from tests.helpers.walker import walk
from viewer.exports.exporting import ExportForm, form_from_json, form_to_json

CLIP = Clip("walk", 60.0, *walk(30))
SHOWN = form_to_json(ExportForm())
JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=4), inner, max_size=3),
    max_leaves=6,
)


def parsed(*words: str) -> ExportOptions:
    parser = argparse.ArgumentParser()
    add_export_arguments(parser)
    return export_options(parser.parse_args(words))


def values_of(name: str) -> st.SearchStrategy[Any]:
    """What the window lets one choose."""
    spec, usual = spec_of(ExportForm, name), getattr(ExportForm(), name)
    if spec.choices is not None:
        return st.sampled_from(list(spec.choices))
    return st.booleans() if isinstance(usual, bool) else st.floats(spec.low, spec.high)


FORMS = st.builds(ExportForm, **{name: values_of(name) for name in SHOWN})


def test_every_format_has_its_options() -> None:
    assert set(FORMATS) == ALL
    named = set().union(*(form.options for form in FORMATS.values()))
    assert {"rest_frame", "engine", "camera", "unit", "with_takes"} <= named
    assert "rest_frame" not in FORMATS[".mp4"].options


def test_arguments_that_are_not_given_leave_the_defaults() -> None:
    assert parsed() == ExportOptions()


def test_every_argument_reaches_its_option() -> None:
    for field in fields(ExportOptions):
        spec = spec_of(ExportOptions, field.name)
        if not isinstance(spec, ExportSpec) or not spec.flag or field.name in ("start_s", "strides"):
            continue
        if isinstance(field.default, bool):
            words, wanted = [spec.flag], not field.default
        else:
            text = {"fps": "24", "engine": "unity", "unit": "m", "euler_order": "ZXY"}
            text |= {"character_unit": "mm", "quality": "software"}
            word = text.get(field.name, "7" if isinstance(field.default, float) else "a.obj")
            words, wanted = [spec.flag, word], spec.parse(word)
        if field.name == "humanoid_names":
            words += ["--for", "unity"]
        found = getattr(parsed(*words), field.name)
        assert found == ((wanted,) if field.name == "with_takes" else wanted), field.name
    options = parsed("--range", "2:6.5", "--loop", "--strides", "3", "--fps", "29.97")
    assert (options.start_s, options.end_s, options.strides) == (2.0, 6.5, 3)
    assert options.fps == options.film_fps == 30000 / 1001


@settings(deadline=None)
@given(FORMS)
def test_a_form_comes_back_from_json(form: ExportForm) -> None:
    assert form_from_json(form_to_json(form)) == form


@settings(deadline=None)
@given(st.dictionaries(st.sampled_from([*SHOWN, "character", "x"]), JSON))
def test_whatever_stands_in_json_is_a_form_that_the_window_can_show(value: dict[str, Any]) -> None:
    form = form_from_json(value)
    assert form.character is None
    for name in SHOWN:
        spec, found = spec_of(form, name), getattr(form, name)
        assert type(found) is type(getattr(ExportForm(), name)) or found in (spec.choices or {})
        assert isinstance(found, bool) or spec.allows(found)


def test_a_form_is_plain_json() -> None:
    assert form_from_json(parse_json(json.dumps(form_to_json(ExportForm(size="640x360"))))).size == "640x360"


@pytest.mark.parametrize("suffix", [form.suffix for form in FORMATS.values() if not form.film])
def test_an_export_that_is_cancelled_leaves_no_file(suffix: str, tmp_path: Path) -> None:
    """At whichever of its looks at `check` that is."""
    try:
        FORMATS[suffix].check_program(tmp_path)
    except UsageError as error:
        pytest.skip(str(error))
    asked = 0

    def check() -> None:
        nonlocal asked
        asked += 1
        if asked == most:
            raise ExportCancelled("cancelled")

    for most in (1, 2, 3):
        asked = 0
        try:
            save_motion(CLIP, tmp_path / f"take{suffix}", ExportOptions(), Terrain.flat(), check)
        except ExportCancelled:
            assert list(tmp_path.iterdir()) == []
        else:
            assert asked < most
            break
    assert most > 2


@pytest.mark.parametrize("start", ["inf", "nan", "-1"])
def test_a_range_begins_at_a_time(start: str) -> None:
    with pytest.raises(UsageError, match="expected 0 or more"):
        parsed(f"--range={start}:")
