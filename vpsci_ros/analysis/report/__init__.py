"""`vpsci report`: the figures and statistics of the paper's section 4 for a generated dataset, as one HTML page."""
