"""An exam in which a person drives, in a browser on this machine.

In reading order:

* `person_exam`: the exam of a person: each episode is driven in the page and stored as a run
* `person`: a person as the driving system of an exam: the page shows each tick, the pressed keys drive
* `server`: the page and its WebSocket, served to this machine alone at an address with a secret
* `drive_page`: the page of `vpsci drive`: its HTML, the data of a tick that it shows
* `drive_command`: the command `vpsci drive`: a person drives in a browser
"""
