"""The exam of a driving system: conduct, measures, scores, criteria and page.

`conduct` runs the episodes beside the system's `process`, `measures` makes a row of each episode, `scores` defines the
measures, `report` collects them, `criteria` decides, `page` and `figures` show the result.
"""
