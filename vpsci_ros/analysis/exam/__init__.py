"""The exam of a driving system: what its episodes say, with intervals, and a report to read.

`measures` makes a row of each episode, `scores` says what is measured, `statistics` how sure it is, `report` puts it
together, `criteria` judges it, `page` and `figures` show it. Nothing here runs an episode: see `vpsci_ros.ads_test`.
"""
