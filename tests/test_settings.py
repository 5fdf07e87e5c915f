"""Settings: on a stage, in Python, by a budget; and the same set in the schema."""

from __future__ import annotations

import math
from dataclasses import fields, replace
from typing import Any

import pytest
from pxr import Usd, UsdRender

from isolux import SettingsError, SolverSettings, settings_from_stage
from isolux.plugin_registration import SOLVER_API
from isolux.settings import attribute_name

SETTINGS_PATH = "/Render/Settings"


@pytest.fixture
def stage() -> Usd.Stage:
    """A stage that names a RenderSettings prim with IsoluxSolverAPI and nothing authored on it."""
    stage = Usd.Stage.CreateInMemory()
    UsdRender.Settings.Define(stage, SETTINGS_PATH).GetPrim().ApplyAPI(SOLVER_API)
    stage.SetMetadata("renderSettingsPrimPath", SETTINGS_PATH)
    return stage


def solver_attribute(stage: Usd.Stage, name: str) -> Usd.Attribute:
    return stage.GetPrimAtPath(SETTINGS_PATH).GetAttribute(name)


def test_fields_and_schema_are_the_same_set(stage: Usd.Stage) -> None:
    definition = Usd.SchemaRegistry().FindAppliedAPIPrimDefinition(SOLVER_API)
    names = {attribute_name(setting.name) for setting in fields(SolverSettings)}
    assert names - {"isolux:threads"} == set(definition.GetPropertyNames())


@pytest.mark.parametrize(
    "setting", [s for s in fields(SolverSettings) if s.name != "threads"], ids=lambda s: s.name
)
def test_field_and_attribute_agree_on_default_and_range(stage: Usd.Stage, setting: Any) -> None:
    attribute = solver_attribute(stage, attribute_name(setting.name))
    assert attribute.Get() == setting.default
    assert type(attribute.Get()) is type(setting.default)
    limits = attribute.GetHardLimits()
    assert limits.GetMinimum() == setting.metadata.get("minimum")
    maximum = setting.metadata.get("maximum")
    assert limits.GetMaximum() == (None if maximum == math.inf else maximum)
    assert attribute.GetMetadata("allowedTokens") == setting.metadata.get("choices")


def test_a_stage_without_settings_gives_the_defaults() -> None:
    assert settings_from_stage(Usd.Stage.CreateInMemory()) == SolverSettings()


def test_a_prim_with_nothing_authored_gives_the_defaults(stage: Usd.Stage) -> None:
    assert settings_from_stage(stage) == SolverSettings()


def test_a_blocked_attribute_gives_the_default(stage: Usd.Stage) -> None:
    solver_attribute(stage, "isolux:photons").Block()
    assert settings_from_stage(stage) == SolverSettings()


def test_authored_settings_are_read(stage: Usd.Stage) -> None:
    solver_attribute(stage, "isolux:photons").Set(10**10)
    solver_attribute(stage, "isolux:filterInterval").Set("paper")
    solver_attribute(stage, "isolux:creaseAngle").Set(30)
    assert settings_from_stage(stage) == SolverSettings(
        photons=10**10, filter_interval="paper", crease_angle=30.0
    )


@pytest.mark.parametrize(
    ("name", "value"),
    [("isolux:stages", 0), ("isolux:targetError", math.nan), ("isolux:filterInterval", "exact")],
)
def test_an_error_names_the_attribute_by_path(stage: Usd.Stage, name: str, value: Any) -> None:
    solver_attribute(stage, name).Set(value)
    with pytest.raises(SettingsError) as raised:
        settings_from_stage(stage)
    assert raised.value.subject == f"{SETTINGS_PATH}.{name}"


def test_a_stage_without_any_stop_names_its_settings_prim(stage: Usd.Stage) -> None:
    solver_attribute(stage, "isolux:targetError").Set(0)
    with pytest.raises(SettingsError, match=SETTINGS_PATH):
        settings_from_stage(stage)


def test_settings_without_the_api_are_refused(stage: Usd.Stage) -> None:
    solver_attribute(stage, "isolux:photons").Set(1000)
    stage.GetPrimAtPath(SETTINGS_PATH).RemoveAPI(SOLVER_API)
    with pytest.raises(SettingsError, match=r"/Render/Settings\.isolux:photons.*IsoluxSolverAPI"):
        settings_from_stage(stage)


def test_a_missing_settings_prim_is_named() -> None:
    stage = Usd.Stage.CreateInMemory()
    stage.SetMetadata("renderSettingsPrimPath", "/Render/Absent")
    with pytest.raises(SettingsError, match="/Render/Absent"):
        settings_from_stage(stage)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("target_error", -0.01),
        ("target_error", 1.01),
        ("target_error", math.nan),
        ("target_error", "5 %"),
        ("time_budget", math.inf),
        ("photons", -1),
        ("photons", 1e6),
        ("photons", 2**53 + 1),
        ("seed", 2**31),
        ("stages", 0),
        ("stages", 65),
        ("stages", True),
        ("filter_accuracy", 0.0),
        ("filter_sharing", 1.5),
        ("filter_interval", "exact"),
        ("crease_angle", 181.0),
        ("threads", -1),
        ("threads", 2**16 + 1),
    ],
)
def test_a_value_out_of_range_is_refused_by_name(name: str, value: Any) -> None:
    with pytest.raises(SettingsError) as raised:
        SolverSettings(**{name: value})
    assert raised.value.subject == name


@pytest.mark.parametrize(
    ("budget", "stops"),
    [
        ({}, (0.05, 0.0, 0)),
        ({"photons": 10**6}, (0.0, 0.0, 10**6)),
        ({"time_budget": 5.0}, (0.0, 5.0, 0)),
        ({"target_error": 0.01}, (0.01, 0.0, 0)),
        ({"target_error": 0.01, "time_budget": 60.0}, (0.01, 60.0, 0)),
    ],
)
def test_a_budget_takes_the_place_of_other_stops(budget: Any, stops: Any) -> None:
    settings = SolverSettings(seed=3).with_budget(**budget)
    assert (settings.target_error, settings.time_budget, settings.photons) == stops
    assert settings.seed == 3


def test_no_stop_at_all_is_refused() -> None:
    with pytest.raises(SettingsError, match="0 for all three"):
        SolverSettings(target_error=0)
    with pytest.raises(SettingsError, match="0 for all three"):
        SolverSettings().with_budget(photons=0)


def test_replacing_a_field_checks_it() -> None:
    assert replace(SolverSettings(), threads=2).threads == 2
    with pytest.raises(SettingsError, match="threads"):
        replace(SolverSettings(), threads=-2)
