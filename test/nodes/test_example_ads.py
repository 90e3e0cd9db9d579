"""The driving system to copy: when it brakes, how firmly, and that its node is of public packages alone."""

import ast
import math
import re
from collections.abc import Iterator
from pathlib import Path

import pytest
import rclpy
from nav_msgs.msg import Odometry

from vpsci_ros.nodes import example_ads, example_driver
from vpsci_ros.nodes.example_driver import ExampleDriver, Mover


@pytest.fixture
def ads(domain: int) -> Iterator[example_ads.ExampleAds]:
    rclpy.init(domain_id=domain)
    node = example_ads.ExampleAds()
    yield node
    node.destroy_node()
    rclpy.shutdown()


def odometry(x: float, speed: float, tick: int) -> Odometry:
    message = Odometry()
    message.header.stamp.nanosec = 50_000_000 * tick
    message.pose.pose.position.x, message.twist.twist.linear.x = x, speed
    return message


DRIVER = ExampleDriver()


def test_on_a_free_road_it_goes_to_its_cruise_speed_and_stays_there() -> None:
    away = [Mover(100.0, 50.0, 0.0, 1.0)]
    assert DRIVER.acceleration(Mover(0.0, 0.0, 0.0, 0.0), away) == 2.0
    assert DRIVER.acceleration(Mover(0.0, 0.0, 0.0, 4.0), away) == pytest.approx(0.0)
    assert DRIVER.acceleration(Mover(0.0, 0.0, 0.0, 6.0), []) == -2.0


def test_it_brakes_for_somebody_in_its_way_the_more_firmly_the_nearer() -> None:
    ahead = [30.0, 12.0, 5.0, 4.0]
    commands = [DRIVER.acceleration(Mover(0.0, 0.0, 0.0, 5.0), [Mover(x, 0.0, 0.0, 0.0)]) for x in ahead]
    assert commands == pytest.approx([-2.0, -3.0, -6.25, -8.0])


def test_it_brakes_for_somebody_who_will_be_in_its_way_and_not_for_one_who_will_not() -> None:
    car = Mover(0.0, 0.0, 0.0, 4.0)
    assert DRIVER.acceleration(car, [Mover(8.0, -3.0, 0.5 * math.pi, 2.0)]) <= -3.0
    assert DRIVER.acceleration(car, [Mover(8.0, -3.0, -0.5 * math.pi, 2.0)]) == pytest.approx(0.0)


def test_it_answers_once_a_tick_when_both_are_in_under_their_stamp(ads: example_ads.ExampleAds) -> None:
    sent: list[int] = []
    ads.command.publish = lambda message: sent.append(message.header.stamp.nanosec)
    for tick in (1, 2):
        ads.on_pedestrian(odometry(100.0, 0.0, tick))
        ads.on_vehicle(odometry(0.0, 4.0, tick))
    assert sent == [50_000_000, 100_000_000]


def test_they_import_nothing_of_this_package_but_each_other_so_that_they_can_be_copied() -> None:
    for module, own in ((example_ads, ["vpsci_ros.nodes.example_driver"]), (example_driver, [])):
        tree = ast.parse(Path(str(module.__file__)).read_text())
        modules = [n.module or "" for n in ast.walk(tree) if isinstance(n, ast.ImportFrom)]
        modules += [alias.name for n in ast.walk(tree) if isinstance(n, ast.Import) for alias in n.names]
        assert [name for name in modules if name.startswith("vpsci")] == own


def test_the_program_in_the_documentation_is_python_and_its_topics_are_the_worlds() -> None:
    page = (Path(__file__).parents[2] / "docs" / "ads.md").read_text(encoding="utf-8")
    (program,) = (text for text in re.findall(r"```python\n(.*?)```", page, re.DOTALL) if "rclpy" in text)
    compile(program, "docs/ads.md", "exec")
    assert {"vehicle/cmd_accel", "vehicle/odometry"} <= {
        node.value for node in ast.walk(ast.parse(program)) if isinstance(node, ast.Constant)
    }
