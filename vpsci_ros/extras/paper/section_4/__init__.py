"""Statistics and figures of the paper's section 4: a dataset beside recordings; comparison of safety measures.

In reading order:

* `section_4_page`: the report of a dataset: numbers as JSON and as a table, pictures as PNG
* `encounters`: a row for each interaction: the onset of the risk and its outcome (sections 4.3, 4.5 and 4.6)
* `comparison`: similarity of generated and recorded interactions, in numbers with intervals (section 4.3)
* `bins`: conflicts and yielding by distance, speed and acceleration at the onset: Figures 9 and 11 to 13 as numbers
* `table`: sections 4.3, 4.5 and 4.6 as one table in Markdown: recordings, their halves as the control, datasets
* `figures`: pictures of a report: least CurvTTC (Figure 8), conflicts by speed (Figure 11), yielding (Figures 9, 12
* `snapshots`: sequential snapshots in the manner of the paper's Figure 5: a row an episode
* `typical_episodes`: the episodes of a picture: one of each scenario
* `safety_compare`: `vpsci safety compare`: how often each safety measure detects the others' conflicts
* `report_commands`: the commands of section 4: `vpsci report` and `vpsci safety`
"""
