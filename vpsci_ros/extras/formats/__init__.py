"""Other file formats: `vpsci export` writes episodes of datasets, bags or exams in them; importers read recordings.

`movers` holds what all formats write of an episode. `openscenario` (with the maps of `opendrive`), `commonroad`, `osi`,
`lanelet2`, `scenarionet`, `minari` and `mp4` write one format each. `run` has the list of formats, to
which other Python packages add theirs. `track_tables` has importers. The libraries are optional (extras
`formats` and `commonroad`): a missing one is named with the command that installs it.
"""
