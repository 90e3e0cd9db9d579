"""The page that plays episodes from above: one file that opens from disk in a browser.

`episode_sources` reads the episodes of near-miss tables, datasets and bags by one function, `view_page` compresses them
and writes the file. `templates` has the page: plain JavaScript that draws on canvases.
"""
