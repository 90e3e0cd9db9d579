"""Our episodes in other people's formats: `vpsci export` reads a dataset, bag or exam and writes files.

`movers` is what every format writes of an episode; `openscenario` (with `opendrive`), `commonroad`, `osi`, `lanelet2`,
`scenarionet` and `carla_csv` know one format each; `run` is the door, with the list of formats, to which other
distributions add theirs. The libraries of the formats are optional (extras of setup.py): a missing one is named with
the command that installs it.
"""

from vpsci_ros.data.episode import Episode
from vpsci_ros.export.run import EXPORTERS, Exporter, Options, export

__all__ = ["EXPORTERS", "Episode", "Exporter", "Options", "export"]
