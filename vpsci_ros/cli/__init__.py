"""The `vpsci` command: a file for each group of subcommands; `main` joins them.

In reading order:

* `main`: the `vpsci` command. Each subcommand imports what it needs when it runs, so that `vpsci --help` is quick
* `options`: options that several commands share
* `parameter_file`: parameter files: the parameters that each stage reads; any other parameter is refused
* `exam`: the command `vpsci ads-test`, which examines a driving system
* `demo`: the demonstration: an import, two short trainings, a generation by nodes, and a page that plays episodes
* `doctor`: `vpsci doctor`: which extras are installed, what each is for, and whether the ROS 2 middleware works here
* `dataset`: the commands about generated datasets: `vpsci generate`, and `vpsci dataset` info, verify, bag, merge
* `bag`: the commands about recorded bags: `vpsci bag` info, export, verify, repair
* `people`: `vpsci people`: a bank of recorded reactions from near misses
* `learning`: the commands that learn from recordings: `vpsci import`, `pretrain`, `refine` and `evaluate`
* `stages`: stages 1 and 2 as commands in one process: their inputs by a parameter file, and their runs
* `evaluation`: the work of `vpsci evaluate`: errors of policies and naive controls on near misses
* `view`: the command `vpsci view`, which writes a page that plays episodes
* `launch_arguments`: the arguments of `ros2 launch` and the nodes' parameter file made from them. It does not import
* `added`: commands that other Python packages, and the folders of `vpsci_ros/extras/`, add to `vpsci` by entry points
"""
