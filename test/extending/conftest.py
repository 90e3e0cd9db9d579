"""Other people's distributions, as if somebody had installed them."""

import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from extending.page import Install

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib


@pytest.fixture
def domain() -> Iterator[None]:
    """Have this process and its children speak in a ROS domain of their own."""
    from vpsci_ros.nodes.domain import own_domain

    with own_domain():
        yield


@pytest.fixture
def install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Install:
    """Return the function that makes files importable, and their `pyproject.toml` found, here and in child processes.

    It writes what an installer leaves: the modules, and a .dist-info folder with the entry points beside them.
    """

    def installed(files: dict[str, str]) -> Path:
        project = tomllib.loads(files["pyproject.toml"])["project"]
        site = tmp_path / f"site-{project['name']}"
        info = site / f"{project['name'].replace('-', '_')}-{project['version']}.dist-info"
        info.mkdir(parents=True)
        for name, text in files.items():
            (site / name).write_text(text, encoding="utf-8")
            monkeypatch.delitem(sys.modules, Path(name).stem, raising=False)
        metadata = f"Metadata-Version: 2.1\nName: {project['name']}\nVersion: {project['version']}\n"
        (info / "METADATA").write_text(metadata, encoding="utf-8")
        lines = []
        for group, points in project["entry-points"].items():
            lines += [f"[{group}]", *(f"{name} = {value}" for name, value in points.items())]
        (info / "entry_points.txt").write_text("\n".join(lines) + "\n", encoding="utf-8")
        monkeypatch.syspath_prepend(str(site))
        monkeypatch.setenv("PYTHONPATH", str(site), prepend=":")
        return site

    return installed
