"""The page that plays episodes from above: one file that opens from disk in a browser.

`episode_sources` reads the episodes of near-miss tables, datasets and bags by one function, `pack` compresses
them, `view_page` writes the file. `templates` has the page: plain JavaScript that draws on canvases.
"""
