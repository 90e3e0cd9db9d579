"""Other file formats: `vpsci export` writes episodes of datasets, bags or exams in them; importers read recordings.

The libraries are optional (extras `formats` and `commonroad`): a missing one is named with the command that installs
it. Other Python packages can add formats to `exporters`.

In reading order:

* `exporters`: the entry point of the exporters
* `movers`: the data of an episode that exporters write: poses, velocities and boxes of road users, and the road
* `openscenario`: episodes as ASAM OpenSCENARIO XML 1.2, each on an OpenDRIVE map
* `opendrive`: a scenario's road as an ASAM OpenDRIVE map: the vehicle's lane along its centreline
* `commonroad`: episodes as CommonRoad scenarios (2020a XML): lane, pedestrians as obstacles
* `osi`: episodes as ASAM OSI ground truth in MCAP, one trace an episode, with the metadata that OSI requires
* `lanelet2`: a scenario's lane and crosswalk as a Lanelet2 map (.osm), as Autoware and other stacks load it
* `scenarionet`: episodes as a ScenarioNet database, which MetaDrive replays: one record a file
* `mp4`: episodes as videos from above (H.264 in MP4, like the paper's 144 example videos), encoded by PyAV
* `track_tables`: recordings published as tables of tracks: levelXData, INTERACTION, SinD, Argoverse 2 and TGSIM
* `vci`: VCI-DUT and VCI-CITR: drone recordings of pedestrians among cars on a campus, and around a golf cart
* `cqut_pvi`: CQUT-PVI: cars that turn right while a pedestrian crosses, at two unsignalised corners in Chongqing
* `export_command`: the command `vpsci export`
"""
