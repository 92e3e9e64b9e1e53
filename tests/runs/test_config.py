"""The configuration: strict at every depth, and a dump that can be read again."""

from dataclasses import asdict
from importlib.metadata import version

import pytest
import yaml

from maps.errors import InputError
from runs.config import RunConfig, read_config, write_config


def read(tmp_path, text):
    path = tmp_path / "config.yaml"
    path.write_text(text)
    return read_config(path)


def test_what_is_left_out_keeps_its_default(tmp_path):
    config = read(tmp_path, "seed: 7\nlocalizer: {gate: 0.99}\n")
    assert (config.seed, config.localizer.gate) == (7, 0.99)
    assert config.smoother == RunConfig().smoother
    assert config.localizer.history_s == RunConfig().localizer.history_s


@pytest.mark.parametrize(
    ("text", "key"),
    [
        ("sed: 1", "sed"),
        ("localizer: {gait: 0.9}", "localizer.gait"),
        ("localizer: {window: {nothing: 1}}", "localizer.window.nothing"),
        ("matcher: {lines: {nothing: 1}}", "matcher.lines.nothing"),
        ("localizer: {gate: .nan}", "localizer.gate"),
        ("localizer: {gate: high}", "localizer.gate"),
        ("odometry: 3", "odometry"),
    ],
)
def test_error_names_the_key(tmp_path, text, key):
    with pytest.raises(InputError) as error:
        read(tmp_path, text)
    assert error.value.where == key


def test_dump_is_resolved_and_can_be_read_again(tmp_path):
    path = tmp_path / "config.yaml"
    config = read(tmp_path, "seed: 7\nlocalizer: {gate: 0.99}\n")
    write_config(path, config, {"session": "toy"})
    content = yaml.safe_load(path.read_text())
    assert content["run"] == {"session": "toy"}
    assert content["versions"]["numpy"] == version("numpy")
    assert content["localizer"]["history_s"] == RunConfig().localizer.history_s
    assert asdict(read_config(path)) == asdict(config)
