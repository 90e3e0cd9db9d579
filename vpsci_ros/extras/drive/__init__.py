"""A person drives in a browser on this machine: an exam whose driving system is you.

`server` serves the page to this machine alone, `page` turns keys into commands, `run` conducts the exam, and `watch`
shows a running graph in the same page.
"""
