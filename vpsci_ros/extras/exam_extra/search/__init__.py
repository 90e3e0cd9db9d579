"""The search for episodes in which a driving system fails, and the estimate of their number.

`imitation` learns from the driving system's episodes how it drives, `seek` rehearses thousands of episodes with that
stand-in, `risk` turns the margins that come out into probabilities, and `run` has the driving system itself drive where
a failure is likely. Only what it drives itself counts as a failure.
"""
