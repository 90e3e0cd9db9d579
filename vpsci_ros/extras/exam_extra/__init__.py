"""Additions to the exam: search for rare failures, explanation of failures, a standard protocol, a socket.

`commands` has the commands, each of which conducts runs by `vpsci_ros.exam.conduct`.
"""
