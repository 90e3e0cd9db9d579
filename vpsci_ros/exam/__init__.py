"""The exam of a driving system: prepare it, conduct it, and report its results.

In reading order:

* `exam`: what is asked: parameters, driving system, episodes and pedestrians, read and checked before any run
* `conduct`: the order of an exam's runs, and the exam from its first run to its report
* `run`: one run: the driving system meets one pedestrian, in the graph of nodes or in the loop
* `drivers`: who drives: the messages between exam and driving system, the check of its answers, the loop
* `simulation`: `vpsci_ros.simulate`: episodes by one call, in this process; no file is written
* `process`: the process of a driving system: a program, or a class that answers there
* `recorded_people`: pedestrians with given motion in the episodes of a run: recordings, or absent pedestrians
* `timing`: the times at which an exam's pedestrians set out: for the driving system's own approach
* `travel`: an exam on another machine: the user's files that go with it
* `result`: the result of a run of an exam: its episodes, whatever the driving system was, and how the run went
* `measures`: the table of an exam's episodes: a row for each driver, pedestrian and episode, with all measures
* `scores`: the measures of an exam, each with its definition, unit and estimator, in one table
* `report`: an exam's scores as one dictionary, which report.json stores and the report page shows
* `criteria`: criteria such as "SR-12: collision_rate > 0.05 @learned": parsed without evaluating code
* `power`: how large a change an exam can see, and how many episodes a change needs, in words
* `comparison`: the comparison with an earlier exam: which episodes are fixed, newly or still failing
* `report_page`: an exam's report as a self-contained HTML page: a picture, what changed, and all results
* `terminal`: an exam's results as a table on the terminal
* `view`: an exam's episodes for the page that plays them: the driving system beside the autopilot
* `markdown`: the verdict of an exam as Markdown for a merge request (summary.md)
* `junit`: the verdict of an exam as JUnit XML (junit.xml), for continuous integration
"""
