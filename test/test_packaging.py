"""Packaging: what is declared in five files agrees, and what is installed is complete and can be found."""

import ast
import os
import re
import shutil
import subprocess
import sys
import sysconfig
import tarfile
import xml.etree.ElementTree as ET
import zipfile
from functools import cache
from importlib.metadata import entry_points
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

import vpsci_ros
from vpsci_ros.resources import messages_dir, params_dir

ROOT = Path(vpsci_ros.__file__).resolve().parents[1]
SETUP = {
    node.targets[0].id: ast.literal_eval(node.value)
    for node in ast.parse((ROOT / "setup.py").read_text()).body
    if isinstance(node, ast.Assign) and node.targets[0].id in ("EXECUTABLES", "REQUIRED", "EXTRAS", "BRANCHES")
}
REQUIREMENTS = [
    Requirement(line) for line in SETUP["REQUIRED"] + [line for extra in SETUP["EXTRAS"].values() for line in extra]
]
# Names that differ between an import and the package that brings it: (requirement in setup.py, key of rosdep or None).
NAMES = {"yaml": ("pyyaml", "python3-yaml"), "rosbags": ("rosbags", "python3-rosbags-pip")}
NO_ROSDEP_KEY = {"lz4", "mcap", "polars", "pyarrow", "safetensors", "zstandard"}
OPTIONAL = {"gymnasium", "pettingzoo", "PIL", "sklearn", "threadpoolctl", "tornado"}  # of extras
OPTIONAL |= {"cloudpickle", "distributed"}
OPTIONAL |= {"av", "carla", "commonroad", "google", "osi3", "osi_utilities", "scenariogeneration"}
NOT_REQUIRED = {"builtin_interfaces", "rcl_interfaces", "tf2_msgs", "vpsci_msgs"}  # with rclpy and this repository
ROS = {"domain_coordinator", "launch", "launch_ros", "rclpy", "std_srvs"}  # and whatever ends in _msgs or _interfaces


@cache
def imported(folder: str) -> set[str]:
    """Return the top-level modules that a folder's files import, without the standard library and this package."""
    names = set()
    for path in (ROOT / folder).rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                names |= {alias.name for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and node.level == 0:
                names.add(node.module)
    return {name.partition(".")[0] for name in names} - set(sys.stdlib_module_names) - {"vpsci_ros"}


NODE_CLASSES, ABSTRACT = {"Node", "GraphNode", "AgentPolicy", "WorldSimulator"}, {"graph_node", "agent_policy"}


def manifest(path: str = "package.xml") -> ET.Element:
    return ET.parse(ROOT / path).getroot()


def test_every_node_is_an_executable_and_nothing_else_is():
    nodes = set()
    for path in [*(ROOT / "vpsci_ros" / "nodes").glob("*.py"), *(ROOT / "vpsci_ros" / "extras").glob("*/node.py")]:
        for each in ast.parse(path.read_text()).body:
            if isinstance(each, ast.ClassDef):
                name, of = each.name, {ast.unparse(base) for base in each.bases}
            elif isinstance(each, ast.Assign) and isinstance(each.value, ast.Call):  # a class with parameters
                name, of = ast.unparse(each.targets[0]), {ast.unparse(argument) for argument in each.value.args[:1]}
            else:
                continue
            if of & NODE_CLASSES:
                nodes.add(re.sub("(?<=[a-z])(?=[A-Z])", "_", name).lower())
    assert sorted(nodes - ABSTRACT) == SETUP["EXECUTABLES"]


def test_the_three_places_of_the_version_agree():
    versions = {manifest().findtext("version"), manifest("msg_defs/package.xml").findtext("version")}
    assert versions == {vpsci_ros.__version__}


@pytest.mark.filterwarnings("ignore:nodes.Node.traverse:DeprecationWarning")  # which catkin_pkg calls
@pytest.mark.parametrize("folder", [".", "msg_defs"])
def test_bloom_reads_the_versions_and_dates_of_the_changelog(folder):
    changelog = pytest.importorskip("catkin_pkg.changelog").get_changelog_from_path(str(ROOT / folder))
    headings = re.findall(r"^## \[(\d\S+)\] - (\S+)$", (ROOT / "CHANGELOG.md").read_text(), re.MULTILINE)
    read = [(version, f"{date:%Y-%m-%d}") for version, date, _ in changelog.foreach_version()]
    assert read == headings
    assert headings[0][0] == vpsci_ros.__version__
    name = manifest(f"{folder}/package.xml").findtext("name")
    assert f"Changelog for package {name}" in (ROOT / folder / "CHANGELOG.rst").read_text()


def test_package_xml_names_every_import_once():
    dependencies = [element.text for element in manifest().iter("exec_depend")]
    used = (imported("vpsci_ros") | imported("launch")) - OPTIONAL - {"torch"}
    of_python = used - ros_modules(used) - NO_ROSDEP_KEY
    keys = {NAMES[name][1] if name in NAMES else f"python3-{name}" for name in of_python}
    assert sorted(dependencies) == sorted(keys | ros_modules(used) | {"rmw_fastrtps_cpp"})


def test_setup_py_requires_every_import_and_nothing_unused():
    used = imported("vpsci_ros") - OPTIONAL - {"torch"}
    required = {Requirement(line).name for line in SETUP["REQUIRED"]}
    assert required == {NAMES[name][0] if name in NAMES else name for name in used - ros_modules(used)}
    of_ros = {Requirement(line).name for line in SETUP["EXTRAS"]["ros"]}
    wanted = {f"ros-jazzy-{name}".replace("_", "-") for name in ros_modules(used) - NOT_REQUIRED}
    assert of_ros == wanted | {"ros-jazzy-rmw-fastrtps-cpp"}


def ros_modules(names: set[str]) -> set[str]:
    """Return those of the modules that come from ROS 2 rather than from Python's package index."""
    return {name for name in names if name in ROS or name.endswith(("_msgs", "_interfaces"))}


def test_every_requirement_is_pinned_by_a_constraint_within_its_range():
    pins = constraints()
    for requirement in REQUIREMENTS:
        if requirement.name != "colcon-common-extensions":  # for those who build with colcon, who bring theirs
            (pin,) = pins[canonicalize_name(requirement.name)]
            assert requirement.specifier.contains(pin), f"{requirement} excludes the tested {pin}"


def constraints() -> dict[str, list[str]]:
    """Return package -> pinned versions that apply to this Python."""
    pins: dict[str, list[str]] = {}
    for line in (ROOT / "constraints.txt").read_text().splitlines():
        if line and not line.startswith("#"):
            requirement = Requirement(line)
            (specifier,) = requirement.specifier
            assert specifier.operator == "==", line
            if requirement.marker is None or requirement.marker.evaluate():
                pins.setdefault(canonicalize_name(requirement.name), []).append(specifier.version)
    return pins


def test_each_test_that_make_test_leaves_to_make_test_engines_is_there():
    """Pytest runs nothing at all where one of the paths that it is given is missing."""
    named = re.search(r"ENGINE_TESTS := \$\(addprefix test/,(.*?)\)\n", (ROOT / "Makefile").read_text(), re.DOTALL)
    paths = named[1].replace("\\\n", " ").split()
    assert len(paths) > 10
    assert [path for path in paths if not (ROOT / "test" / path).exists()] == []


def test_every_entry_point_of_the_installed_package_loads():
    scripts = [script for script in entry_points(group="console_scripts") if script.value.startswith("vpsci_ros")]
    assert sorted(script.name for script in scripts) == sorted([*SETUP["EXECUTABLES"], "vpsci"])
    assert all(callable(script.load()) for script in scripts)
    for group, wanted in SETUP["BRANCHES"].items():
        points = [point for point in entry_points(group=group) if point.value.startswith("vpsci_ros.")]
        assert sorted(f"{point.name} = {point.value}" for point in points) == sorted(wanted), "run `make setup`"
        assert all(point.load() is not None for point in points)


def installed(package: str) -> Path:
    """Return where a package is installed: in an ament prefix, as colcon and ROS 2 set them, or with this Python."""
    prefixes = [Path(each) for each in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep) if each]
    found = [each for each in (*prefixes, Path(sys.prefix)) if (each / "share" / package / "package.xml").exists()]
    assert found, f"{package} is in none of {[*map(str, prefixes), sys.prefix]}: run `make setup` or `colcon build`"
    return found[0]


def test_ament_index_finds_the_package_and_ros2_run_would_find_its_executables(monkeypatch):
    packages = pytest.importorskip("ament_index_python.packages")
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(installed("vpsci_ros")))
    prefix = Path(packages.get_package_prefix("vpsci_ros"))
    assert (prefix / "share/vpsci_ros/package.xml").read_text() == (ROOT / "package.xml").read_text()
    found = [path.name for path in (prefix / "lib/vpsci_ros").iterdir() if os.access(path, os.X_OK)]
    assert set(SETUP["EXECUTABLES"]) <= set(found)


def test_an_executable_that_ros2_run_would_start_refuses_a_parameter_out_of_range():
    command = [installed("vpsci_ros") / "lib/vpsci_ros/perception", "--ros-args", "-p", "latency:=-1.0"]
    result = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert result.returncode == 2
    assert "latency = -1.0 is out of range" in result.stderr


@pytest.fixture(scope="module")
def distributions(tmp_path_factory):
    """The source distribution of this tree and a wheel that is made of it, offline, as `make dist` makes them."""
    folder = tmp_path_factory.mktemp("source")
    tree, made = folder / "tree", folder / "dist"
    ignored = shutil.ignore_patterns(".*", "__pycache__", "out", "build", "install", "log", "dist", "*.egg-info")
    shutil.copytree(ROOT, tree, ignore=ignored)
    sdist = [sys.executable, "-W", "ignore", "setup.py", "-q", "sdist", "-d", made]
    subprocess.run(sdist, cwd=tree, check=True, timeout=300)
    (source,) = made.glob("*.tar.gz")
    pip_wheel = [sys.executable, "-m", "pip", "-qq", "wheel", "--no-deps", "--no-build-isolation"]
    subprocess.run([*pip_wheel, "-w", made, source], check=True, timeout=300)
    (wheel,) = made.glob("*.whl")
    return source, wheel


@pytest.fixture(scope="module")
def wheel(distributions):
    """The wheel, opened."""
    return zipfile.ZipFile(distributions[1])


def test_twine_accepts_both_distributions_without_a_warning(distributions):
    check = [sys.executable, "-m", "twine", "check", "--strict", *distributions]
    result = subprocess.run(check, capture_output=True, text=True, timeout=60)
    assert result.returncode == 0, result.stdout + result.stderr
    assert result.stdout.count("PASSED") == 2


def test_a_source_distribution_holds_every_file_of_the_repository_but_what_serves_its_hosting(distributions):
    listed = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True)
    if listed.returncode:
        pytest.skip("not a git checkout, so what belongs to the repository is not known")
    with tarfile.open(distributions[0]) as archive:
        held = {name.partition("/")[2] for name in archive.getnames()}
    kept_out = (".gitignore", ".dockerignore", ".devcontainer/", ".ci/")
    present = [name for name in listed.stdout.splitlines() if (ROOT / name).exists()]
    assert [name for name in present if name not in held and not name.startswith(kept_out)] == []


def test_a_wheel_holds_the_licences_of_the_package_and_of_the_recordings_and_names_them(wheel):
    info = f"vpsci_ros-{vpsci_ros.__version__}.dist-info/"
    for name in ("LICENSE", "vpsci_ros/recordings/LICENSE"):
        assert f"License-File: {name}" in wheel.read(f"{info}METADATA").decode()
        assert wheel.read(f"{info}licenses/{name}") == (ROOT / name).read_bytes()


def test_a_wheel_holds_what_ros2_run_and_ros2_launch_look_for(wheel):
    data = f"vpsci_ros-{vpsci_ros.__version__}.data/data/"
    names = {name.removeprefix(data): name for name in wheel.namelist()}
    assert "share/ament_index/resource_index/packages/vpsci_ros" in names
    assert "share/vpsci_ros/package.xml" in names
    shared = [("launch", "*.py"), ("params", "*.yaml"), ("rviz", "*.rviz"), ("urdf", "*.urdf")]
    for path in [path for folder, pattern in shared for path in (ROOT / folder).rglob(pattern)]:
        assert wheel.read(names[f"share/vpsci_ros/{path.relative_to(ROOT)}"]) == path.read_bytes()
    for executable in SETUP["EXECUTABLES"]:
        mode = wheel.getinfo(names[f"lib/vpsci_ros/{executable}"]).external_attr >> 16
        assert mode & 0o111 == 0o111, executable


def test_a_wheel_holds_every_module_model_and_template(wheel):
    models = (path for pattern in ("*.safetensors", "*.md") for path in (ROOT / "vpsci_ros/models").glob(pattern))
    templates = [*(ROOT / "vpsci_ros").rglob("templates/*"), *(ROOT / "vpsci_ros").rglob("layouts/*")]
    recordings = (ROOT / "vpsci_ros/recordings").iterdir()
    for path in [*(ROOT / "vpsci_ros").rglob("*.py"), *models, *templates, *recordings]:
        assert str(path.relative_to(ROOT)) in wheel.namelist()


def test_parameter_files_and_message_definitions_are_found_in_an_installed_prefix(wheel, tmp_path):
    wheel.extractall(tmp_path)
    shutil.move(tmp_path / f"vpsci_ros-{vpsci_ros.__version__}.data/data", tmp_path / "prefix")
    packages = tmp_path / "prefix" / Path(sysconfig.get_path("purelib")).relative_to(sys.prefix)
    packages.mkdir(parents=True)
    shutil.move(tmp_path / "vpsci_ros", packages)
    assert params_dir(packages / "vpsci_ros") == tmp_path / "prefix/share/vpsci_ros/params"
    messages = {path.name for path in messages_dir(packages / "vpsci_ros").glob("*.msg")}
    assert messages == {path.name for path in (ROOT / "msg_defs/msg").glob("*.msg")}


def test_set_up_names_in_one_line_what_the_machine_lacks(tmp_path):
    environment = {**os.environ, "CXX": "no-such-program"}
    command = ["sh", ROOT / "tools/setup.sh", tmp_path / "venv"]
    result = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=60)
    assert result.returncode == 1
    assert "needs a C++ compiler" in result.stderr
    assert "no-such-program" in result.stderr
    assert len((result.stdout + result.stderr).splitlines()) == 1
    assert not (tmp_path / "venv").exists()


def test_hashes_are_those_of_the_tested_versions() -> None:
    hashed = [line.split(" --hash=sha256:") for line in lines(ROOT / "constraints-hashes.txt")]
    assert all(re.fullmatch("[0-9a-f]{64}", digest) for _, digest in hashed)
    tested = {line.partition(";")[0].strip() for line in lines(ROOT / "constraints.txt")}
    hashed = [row for row in hashed if not row[0].startswith("protobuf==")]  # of two releases; the constraints say why
    assert [version for version, _ in hashed if version not in tested] == []
    named = (ROOT / "docs" / "dependencies.csv").read_text(encoding="utf-8")
    assert [version for version, _ in hashed if "\n{},{},".format(*version.split("==")) not in named] == []


def lines(path: Path) -> list[str]:
    """Return the lines of a file of requirements, without comments."""
    return [line for line in path.read_text(encoding="utf-8").splitlines() if line and not line.startswith("#")]
