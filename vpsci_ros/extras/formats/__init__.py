"""Other people's formats: `vpsci export` writes a dataset, bag or exam in them, further importers read recordings.

`movers` is what every format writes of an episode; `openscenario` (with `opendrive`), `commonroad`, `osi`, `lanelet2`,
`scenarionet`, `minari`, `mp4` and `carla_csv` know one format each; `run` is the door, with the list of formats, to
which other distributions add theirs. `hc`, `taf_bw` and `track_tables` are importers. The libraries of the formats are
optional (extra `formats` of setup.py): a missing one is named with the command that installs it.
"""
