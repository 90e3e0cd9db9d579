"""The search for episodes in which a driving system fails, and the estimate of their number.

`imitation` learns from the driving system's episodes how it drives, `seek` simulates thousands of episodes with that
surrogate, `risk` turns the resulting margins into probabilities, and `run` has the driving system drive where a failure
is likely. Only failures of the driving system itself count.
"""
