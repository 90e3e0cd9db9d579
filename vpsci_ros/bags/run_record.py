"""How a bag was made: parameters of the nodes, hashes of weights and scenarios, versions; text records in the bag.

`vpsci_node` (a node's name, its parameters as JSON, the SHA-256 of its weights file), `vpsci_weights` (version and
SHA-256 of weights that a learner published), `vpsci_software` (versions, kind of CPU, SHA-256 of scenario files),
`vpsci_scenario` (a scenario that is not the paper's), and `vpsci_ros` at the end of each file (messages seen, written).
"""

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from vpsci_ros.bags.reader import Bag
from vpsci_ros.bags.writer import RUN
from vpsci_ros.documents import reason
from vpsci_ros.errors import InvalidInput
from vpsci_ros.resources import weights_path
from vpsci_ros.runs.files import sha256
from vpsci_ros.runs.provenance import cpu_name, software_versions
from vpsci_ros.world import Scenario
from vpsci_ros.world.scenario import every_scenario, own_documents, own_scenarios, scenario_files

NODE, WEIGHTS, SOFTWARE, SCENARIO = "vpsci_node", "vpsci_weights", "vpsci_software", "vpsci_scenario"


@dataclass(frozen=True)
class BagRun:
    """The records in a bag about its run; empty if it has none.

    :ivar parameters: node -> its parameters.
    :ivar weights: node -> SHA-256 of its weights file, empty where the recorder could not read it.
    :ivar refreshes: of weights that a learner published: their version and SHA-256.
    :ivar software: package -> version, and "cpu".
    :ivar scenario_files: name -> SHA-256.
    :ivar own_scenarios: name -> document of a scenario that is not the paper's.
    :ivar totals: the last record of a file: "messages_seen", "messages_written", "seen" and "written" by topic, ...
    """

    parameters: dict[str, dict[str, Any]] = field(default_factory=dict)
    weights: dict[str, str] = field(default_factory=dict)
    refreshes: list[dict[str, str]] = field(default_factory=list)
    software: dict[str, str] = field(default_factory=dict)
    scenario_files: dict[str, str] = field(default_factory=dict)
    own_scenarios: dict[str, Any] = field(default_factory=dict)
    totals: dict[str, str] = field(default_factory=dict)

    def count(self, what: str) -> dict[str, int]:
        """Return the numbers of "seen", "written" or "refused" messages by topic; empty if the bag was not closed."""
        return {topic: int(count) for topic, count in json.loads(self.totals.get(what, "{}")).items()}


def software_record() -> dict[str, str]:
    """Return the values of the text record about this machine and its software."""
    files = {path.stem: sha256(path) for path in scenario_files()}
    return {**software_versions(), "cpu": cpu_name(), "scenario_files": json.dumps(files)}


def scenario_records(scenarios: Iterable[Scenario]) -> list[dict[str, str]]:
    """Return the values of the text records of scenarios other than the paper's."""
    return [{"name": name, "document": json.dumps(document)} for name, document in own_documents(scenarios).items()]


def node_record(node: str, parameters: Mapping[str, Any], weights_sha256: str | None = None) -> dict[str, str]:
    """Return the values of the text record about a node.

    :param weights_sha256: of its weights; None: of the file that its parameter `weights` names.
    """
    name = parameters.get("weights", "")
    if weights_sha256 is None and name:
        try:
            weights_sha256 = sha256(weights_path(name))
        except (InvalidInput, OSError):
            weights_sha256 = ""  # a file that only the node itself can read
    record = {"node": node, "parameters": json.dumps(dict(parameters), sort_keys=True)}
    return record | ({"weights_sha256": weights_sha256} if weights_sha256 is not None else {})


def bag_run(bag: Bag) -> BagRun:
    """Return the records in a bag about its run.

    :raises InvalidInput: the bag is not whole, see also `Bag.require_complete`, or a record is damaged.
    """
    run = BagRun()
    records = bag.records()
    try:
        for name, values in records:
            if name == NODE:
                run.parameters[values["node"]] = dict(json.loads(values["parameters"]))
                if "weights_sha256" in values:
                    run.weights[values["node"]] = values["weights_sha256"]
            elif name == WEIGHTS and values not in run.refreshes:
                run.refreshes.append(values)
            elif name == SOFTWARE:
                run.software.update({key: text for key, text in values.items() if key != "scenario_files"})
                run.scenario_files.update(json.loads(values.get("scenario_files", "{}")))
            elif name == SCENARIO:
                run.own_scenarios[values["name"]] = json.loads(values["document"])
            elif name == RUN:
                run.totals.clear()
                run.totals.update(values)
        _ = run.count("seen"), run.count("written"), int(run.totals.get("episodes_unfinished", 0))
    except (AttributeError, KeyError, ValueError, TypeError, RecursionError) as error:
        raise InvalidInput(f"{bag.path}: its record of how it was made is damaged: {reason(error)}") from None
    bag.require_complete(run.count("written"))
    return run


def scenarios_of(bag: Bag, *, own: bool = False) -> list[Scenario]:
    """Return the scenarios that may occur in a bag: the paper's, and those stored in the bag.

    :param own: only the latter.
    :raises InvalidInput: see `bag_run`.
    """
    documents, where = bag_run(bag).own_scenarios, str(bag.path)
    return own_scenarios(documents, where) if own else every_scenario(documents, where)
