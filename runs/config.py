"""A run's configuration: the parameters of every stage, one strict loader, one dump."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from enum import Enum
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, Any, ClassVar

import yaml
from annotated_types import Gt
from pydantic import ConfigDict

from localization.fixedlag import FixedLagConfig
from localization.localizer import LocalizerConfig
from localization.odometry import OdometryNoise
from localization.smoother import SmootherConfig
from maps.documents import checked, read_yaml
from runs.parts import PartsConfig
from runs.secondpass import SecondPassConfig
from vision.matcher import MatcherConfig

#: The libraries whose numbers a result depends on.
LIBRARIES = ("wireloc", "numpy", "scipy", "opencv-python-headless", "filterpy", "gtsam", "shapely")
#: What a dump tells beside the parameters; the loader passes over it, so that a dump can be loaded.
PROVENANCE = ("run", "versions")


@dataclass(frozen=True, slots=True)
class RunConfig:
    """The parameters of every stage of a run; see their own classes for units and reasons.

    `match_rate_hz`: frames matched in a second of capture time, at most; None matches every frame.
    """

    odometry: OdometryNoise = field(default_factory=OdometryNoise)
    localizer: LocalizerConfig = field(default_factory=LocalizerConfig)
    matcher: MatcherConfig = field(default_factory=MatcherConfig)
    smoother: SmootherConfig = field(default_factory=SmootherConfig)
    second_pass: SecondPassConfig = field(default_factory=SecondPassConfig)
    parts: PartsConfig = field(default_factory=PartsConfig)
    fixed_lag: FixedLagConfig = field(default_factory=FixedLagConfig)
    match_rate_hz: Annotated[float, Gt(0.0)] | None = None
    #: Of whatever draws random numbers; the same seed gives the same run.
    seed: int = 0

    #: Pydantic hands it on to the parameters' own classes, at any depth.
    __pydantic_config__: ClassVar[ConfigDict] = ConfigDict(extra="forbid", allow_inf_nan=False)


def read_config(path: Path) -> RunConfig:
    """Read a YAML file with some or all of the parameters; those it leaves out keep their defaults.

    InputError names the key that no stage knows, at any depth, or whose value does not fit.
    """
    content = {key: value for key, value in read_yaml(path).items() if key not in PROVENANCE}
    return checked(RunConfig, content, path)


def write_config(path: Path, config: RunConfig, run: dict[str, Any]) -> None:
    """Write the resolved configuration, `run` (what else the run was told) and the versions."""
    versions = {library: version(library) for library in LIBRARIES}
    content = {"run": run, **_plain(asdict(config)), "versions": versions}
    path.write_text(yaml.safe_dump(content, sort_keys=False, allow_unicode=True), encoding="utf-8")


def config_text(config: RunConfig) -> str:
    """Return the resolved parameters as YAML."""
    return str(yaml.safe_dump(_plain(asdict(config)), sort_keys=False, allow_unicode=True))


def _plain(value: Any) -> Any:
    """Return the value with what YAML has no word for turned into what it has."""
    match value:
        case dict():
            return {key: _plain(part) for key, part in value.items()}
        case list() | tuple():
            return [_plain(part) for part in value]
        case Enum():
            return value.value
    return value
