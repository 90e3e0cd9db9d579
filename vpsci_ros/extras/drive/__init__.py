"""An exam in which a person drives, in a browser on this machine.

`server` serves the page to this machine alone, `page` turns keys into commands, `run` conducts the exam, and `watch`
shows a running graph in the same page.
"""
