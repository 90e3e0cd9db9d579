"""The exam of a driving system: prepare it, conduct it, and report its results.

In reading order:

* `exam`: the prepared exam: driving system, episodes and pedestrians, checked before anything runs
* `exam_config`: the configuration of an exam: driving system, pedestrians and criteria
* `conduct_exam`: the exam of a driving system: running, scoring and reporting it
* `conduct`: the runs of an exam: the driving system drives the same episodes with each pedestrian
* `in_process`: a run of an exam without ROS, with a Python class
* `class_process`: a driving system's class in its own process, so that its crashes do not end the exam
* `driver_class`: a driving system as a Python class: finding it, its observations, and its commands
* `in_graph`: a run of an exam through the graph of nodes, for a driving system that is a ROS program, and its result
* `process`: the driving system under test as a process: started with a command line, watched, and stopped
* `recorded_people`: pedestrians with given motion in the episodes of a run: recordings, or absent pedestrians
* `travel`: an exam on another machine: the user's files that go with it
* `result`: the result of a run of an exam: its episodes, whatever the driving system was, and how the run went
* `measures`: the table of an exam's episodes: a row for each driver, pedestrian and episode, with all measures
* `scores`: the measures of an exam, each with its definition, unit and estimator, in one table
* `report`: an exam's scores as one dictionary, which report.json stores and the report page shows
* `criteria`: criteria such as "SR-12: collision_rate > 0.05 @learned": parsed without evaluating code
* `power`: how large a change an exam can see, and how many episodes a change needs, in words
* `comparison`: the comparison with an earlier exam: which episodes are fixed, newly or still failing
* `report_page`: an exam's report: a self-contained HTML page, and a table on the terminal
* `view`: an exam's episodes for the page that plays them: the driving system beside the autopilot
* `markdown`: the verdict of an exam as Markdown for a merge request (summary.md)
* `junit`: the verdict of an exam as JUnit XML (junit.xml), for continuous integration
* `timing`: the times at which an exam's pedestrians set out: for the driving system's own approach
"""
