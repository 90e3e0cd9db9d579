"""The exam of a driving system: held, measured, scored, judged, and shown as a page.

`conduct` runs the episodes beside the system's `process`, `measures` makes a row of each episode, `scores` says what is
measured, `report` puts it together, `criteria` judges it, `page` and `figures` show it.
"""
