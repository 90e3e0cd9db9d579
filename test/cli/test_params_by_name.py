"""The parameter files of the package are found by their names, wherever the package is installed."""

from pathlib import Path

import pytest

from vpsci_ros.errors import InvalidInput
from vpsci_ros.resources import params_dir, params_path


def test_the_packages_own_files_are_found_by_their_names_and_a_file_of_that_name_here_comes_first(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert (
        params_path("stage3_generate") == params_path("stage3_generate.yaml") == params_dir() / "stage3_generate.yaml"
    )
    (tmp_path / "stage3_generate.yaml").write_text("{}")
    assert params_path("stage3_generate.yaml") == Path("stage3_generate.yaml")


def test_another_name_is_refused_with_those_that_there_are() -> None:
    with pytest.raises(
        InvalidInput, match="none: no such parameter file; the package's own are ads_test, .*stage3_generate"
    ):
        params_path("none")
