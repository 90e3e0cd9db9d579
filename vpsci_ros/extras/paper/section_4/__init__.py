"""The statistics and figures of the paper's section 4: a dataset beside recorded people, safety measures compared."""
