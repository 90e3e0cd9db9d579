"""Beside the exam: rare failures searched for, failures explained, a standard protocol, and a socket.

`commands` has the commands, each of which conducts runs by `vpsci_ros.exam.conduct`.
"""
