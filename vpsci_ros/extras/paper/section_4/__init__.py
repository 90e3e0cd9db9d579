"""Statistics and figures of the paper's section 4: a dataset beside recordings; comparison of safety measures."""
