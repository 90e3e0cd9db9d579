"""The exam of a driving system: conducted, measured, scored, checked against criteria, and shown as a page.

`conduct` runs the episodes beside the system's `process`, `measures` makes a row of each episode, `scores` says what is
measured, `report` puts it together, `criteria` says whether it is passed, `page` and `figures` show it.
"""
